SELECT material, record FROM jobs
WHERE stage = 'pending' AND NOT failed_on @> $1::text[] AND material <> ALL ($3)
ORDER BY priority DESC, material
LIMIT $2
FOR UPDATE SKIP LOCKED
