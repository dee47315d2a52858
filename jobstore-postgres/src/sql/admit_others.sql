SELECT pg_advisory_unlock(1651663974, hashtext(current_schema()))
