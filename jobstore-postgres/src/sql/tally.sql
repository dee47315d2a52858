UPDATE tallies
SET pending = pending + $1, leased = leased + $2, completed = completed + $3,
    disputed = disputed + $4, set_aside = set_aside + $5, cancelled = cancelled + $6,
    checks = checks + $7
WHERE shard = pg_backend_pid() % 64
