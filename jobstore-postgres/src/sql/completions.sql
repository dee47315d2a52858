SELECT completion FROM completions JOIN jobs USING (material)
WHERE stage IN ('completed', 'disputed') AND NOT material = ANY ($1)
ORDER BY material
