DELETE FROM sessions WHERE worker = $1
