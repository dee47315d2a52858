DELETE FROM workers WHERE name = ANY ($1)
