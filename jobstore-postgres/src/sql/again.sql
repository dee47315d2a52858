SELECT material, record FROM jobs
WHERE stage = 'pending' AND failed_on <> '{}' AND failed_on && $1::text[] AND material <> ALL ($3)
    AND NOT EXISTS (
        SELECT FROM able
        WHERE able.identity <> 'operator/' AND NOT able.name = ANY (jobs.failed_on)
    )
ORDER BY priority DESC, material
LIMIT $2
FOR UPDATE OF jobs SKIP LOCKED
