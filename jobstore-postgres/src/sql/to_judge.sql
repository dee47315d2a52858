SELECT material, record FROM jobs
WHERE judge_wanted AND renderer <> $1 AND contradictor IS DISTINCT FROM $1
    AND NOT $1 = ANY (failed_on)
ORDER BY stage DESC, material
LIMIT $2
FOR UPDATE SKIP LOCKED
