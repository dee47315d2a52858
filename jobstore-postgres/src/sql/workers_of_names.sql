SELECT name, record, bar_ends_ms FROM workers WHERE name = ANY ($1) ORDER BY name
