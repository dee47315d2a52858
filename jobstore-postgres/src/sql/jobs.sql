SELECT material, record FROM jobs WHERE material = ANY ($1)
