SELECT name FROM sessions WHERE worker = $1
