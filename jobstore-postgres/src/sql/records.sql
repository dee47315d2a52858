SELECT material, record FROM jobs WHERE record IS NOT NULL ORDER BY material
