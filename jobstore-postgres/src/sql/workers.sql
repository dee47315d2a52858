SELECT name, record FROM workers ORDER BY name
