SELECT material FROM jobs WHERE renderer = ANY ($1)
UNION
SELECT material FROM jobs WHERE contradictor = ANY ($1)
