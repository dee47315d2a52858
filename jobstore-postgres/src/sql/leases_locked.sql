SELECT material, token, worker, name, claimed_ms, expires_ms, views_done, progressed_ms
FROM leases WHERE material = ANY ($1) ORDER BY material FOR UPDATE
