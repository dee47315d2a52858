SELECT pg_advisory_lock(1651663974, hashtext(current_schema()))
