SELECT material, record FROM jobs WHERE material = ANY ($1) ORDER BY material FOR UPDATE
