SELECT name FROM workers WHERE barred AND bar_ends_ms <= $1
