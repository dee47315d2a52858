INSERT INTO sessions (worker, name, seen_ms) VALUES ($1, $2, now_ms())
ON CONFLICT (worker) DO UPDATE SET name = excluded.name, seen_ms = excluded.seen_ms
