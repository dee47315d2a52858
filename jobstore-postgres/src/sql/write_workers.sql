INSERT INTO workers (name, barred, failing, bar_ends_ms, record, audit_due, probation)
SELECT new.* FROM unnest(
    $1::text[], $2::boolean[], $3::boolean[], $4::bigint[], $5::text[], $7::boolean[], $8::bigint[]
) AS new (name, barred, failing, bar_ends_ms, record, audit_due, probation)
WHERE new.barred
    OR EXISTS (SELECT FROM workers WHERE workers.name = new.name)
    OR new.name = identity(new.name) AND new.name LIKE '%/'
    OR (SELECT count(*) FROM workers) < $6
ON CONFLICT (name) DO UPDATE
SET barred = excluded.barred, failing = excluded.failing, bar_ends_ms = excluded.bar_ends_ms,
    record = excluded.record, audit_due = excluded.audit_due, probation = excluded.probation
