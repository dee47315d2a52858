-- Makes the role with which the autoscaler asks how much there is to do, or gives it another password.
-- It reads two tables of numbers; tokens of leases stand in others. Those tables are made by the
-- first coordinator that starts: until then this fails, and the job is tried again.
\getenv password READER_PASSWORD
\getenv database PGDATABASE
SELECT 'CREATE ROLE brdfarm_reader'
WHERE NOT EXISTS (SELECT FROM pg_roles WHERE rolname = 'brdfarm_reader') \gexec
ALTER ROLE brdfarm_reader LOGIN CONNECTION LIMIT 8 PASSWORD :'password';
GRANT CONNECT ON DATABASE :"database" TO brdfarm_reader;
GRANT USAGE ON SCHEMA public TO brdfarm_reader;
GRANT SELECT ON tallies, farm TO brdfarm_reader;
