SELECT name FROM workers WHERE name = ANY ($1) AND failing
