INSERT INTO workers (name, barred, failing, bar_ends_ms, record)
SELECT new.* FROM unnest($1::text[], $2::boolean[], $3::boolean[], $4::bigint[], $5::text[])
    AS new (name, barred, failing, bar_ends_ms, record)
WHERE new.barred
    OR EXISTS (SELECT FROM workers WHERE workers.name = new.name)
    OR (SELECT count(*) FROM workers) < $6
ON CONFLICT (name) DO UPDATE
SET barred = excluded.barred, failing = excluded.failing, bar_ends_ms = excluded.bar_ends_ms,
    record = excluded.record
