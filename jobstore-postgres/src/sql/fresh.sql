SELECT material, record FROM jobs
WHERE stage = 'pending' AND NOT $1 = ANY (failed_on)
ORDER BY priority DESC, material
LIMIT $2
FOR UPDATE SKIP LOCKED
