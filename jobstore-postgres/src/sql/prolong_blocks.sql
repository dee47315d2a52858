UPDATE workers SET bar_ends_ms = $1 WHERE bar_ends_ms IS NOT NULL
