-- Who answers for a worker of this full name: the same as jobqueue::identity.
CREATE FUNCTION identity(full_name text) RETURNS text LANGUAGE sql IMMUTABLE AS
    'SELECT CASE WHEN position(''/'' IN full_name) > 1
        THEN left(full_name, position(''/'' IN full_name)) ELSE full_name END';

-- jobs.renderer and jobs.contradictor are identities from here on; so far those of bare names.

-- Of an identity: some of its completions are still to be drawn for an audit, and how many were
-- rendered again because it was new.
ALTER TABLE workers ADD COLUMN audit_due boolean NOT NULL DEFAULT false;
ALTER TABLE workers ADD COLUMN probation bigint NOT NULL DEFAULT 0;
CREATE INDEX workers_to_audit ON workers (name) WHERE audit_due;

-- Whoever is there and may have work.
DROP VIEW able;
CREATE VIEW able AS
    SELECT DISTINCT name, identity(name) AS identity FROM sessions
    WHERE NOT EXISTS (
        SELECT FROM workers
        WHERE workers.name IN (sessions.name, identity(sessions.name)) AND barred
    );

-- Identities whose work is to be audited, and that somebody else who is there can say something about.
-- The operator renders what is disputed and nothing else.
CREATE VIEW audits_due AS
    SELECT name FROM workers
    WHERE audit_due AND NOT barred AND EXISTS (
        SELECT FROM able WHERE able.identity NOT IN (workers.name, 'operator/')
    );
