SELECT material, record, CASE WHEN stage IN ('completed', 'disputed') THEN completion END
FROM jobs LEFT JOIN completions USING (material)
WHERE record IS NOT NULL AND material >= $1
ORDER BY material
LIMIT $2
