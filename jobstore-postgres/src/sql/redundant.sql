SELECT material, record FROM jobs
WHERE judge_wanted AND material <> ALL ($3) AND EXISTS (
    SELECT FROM unnest($1::text[]) AS asker (name)
    WHERE renderer <> identity(name) AND contradictor IS DISTINCT FROM identity(name)
        AND NOT name = ANY (failed_on) AND (stage = 'disputed' OR identity(name) <> 'operator/')
)
ORDER BY stage DESC, material
LIMIT $2
FOR UPDATE OF jobs SKIP LOCKED
