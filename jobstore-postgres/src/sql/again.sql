SELECT material, record FROM jobs
WHERE stage = 'pending' AND failed_on <> '{}' AND $1 = ANY (failed_on)
    AND NOT EXISTS (SELECT FROM able WHERE NOT able.name = ANY (jobs.failed_on))
ORDER BY priority DESC, material
LIMIT $2
FOR UPDATE OF jobs SKIP LOCKED
