SELECT material FROM jobs WHERE stage = 'disputed' ORDER BY material LIMIT 1
