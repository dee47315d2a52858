SELECT name, record, bar_ends_ms FROM workers
WHERE name = ANY ($1) OR name = ANY (ARRAY(SELECT identity(name) FROM unnest($1::text[]) AS of (name)))
ORDER BY name
