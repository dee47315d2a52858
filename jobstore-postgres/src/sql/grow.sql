WITH added AS (
    INSERT INTO jobs (material)
    SELECT generate_series((SELECT coalesce(max(material) + 1, 0) FROM jobs), $1::bigint - 1)
    RETURNING 1
)
UPDATE tallies SET pending = pending + (SELECT count(*) FROM added) WHERE shard = 0
