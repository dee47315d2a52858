UPDATE leases
SET expires_ms = new.expires_ms, views_done = new.views_done, progressed_ms = new.progressed_ms
FROM unnest($1::bigint[], $2::bytea[], $3::bigint[], $4::bigint[], $5::bigint[])
    AS new (material, token, expires_ms, views_done, progressed_ms)
WHERE leases.material = new.material AND leases.token = new.token
