SELECT material FROM jobs ORDER BY material DESC LIMIT 1
