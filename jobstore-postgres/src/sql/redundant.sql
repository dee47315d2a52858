SELECT material, record FROM jobs
WHERE judge_wanted AND material <> ALL ($3) AND EXISTS (
    SELECT FROM unnest($1::text[]) AS asker (name)
    WHERE renderer <> name AND contradictor IS DISTINCT FROM name AND NOT name = ANY (failed_on)
)
ORDER BY stage DESC, material
LIMIT $2
FOR UPDATE OF jobs SKIP LOCKED
