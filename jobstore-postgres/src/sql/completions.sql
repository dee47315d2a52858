SELECT completion FROM completions JOIN jobs USING (material)
WHERE stage IN ('completed', 'disputed')
ORDER BY material
