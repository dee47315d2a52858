SELECT record FROM jobs WHERE material = $1
