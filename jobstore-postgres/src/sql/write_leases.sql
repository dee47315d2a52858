INSERT INTO leases (material, token, worker, name, claimed_ms, expires_ms, views_done, progressed_ms)
SELECT * FROM unnest(
    $1::bigint[], $2::bytea[], $3::bytea[], $4::text[], $5::bigint[], $6::bigint[], $7::bigint[], $8::bigint[]
)
ON CONFLICT (material) DO UPDATE
SET token = excluded.token, worker = excluded.worker, name = excluded.name,
    claimed_ms = excluded.claimed_ms, expires_ms = excluded.expires_ms,
    views_done = excluded.views_done, progressed_ms = excluded.progressed_ms
