-- The jobs of one dataset, one row a material. `record` is the whole truth of a job, as the queue
-- writes it; null is a job without a history. The other columns repeat what indices need of it.
CREATE TYPE stage AS ENUM ('pending', 'leased', 'completed', 'disputed', 'set_aside', 'cancelled');

CREATE TABLE jobs (
    material bigint PRIMARY KEY,
    stage stage NOT NULL DEFAULT 'pending',
    priority integer NOT NULL DEFAULT 0,
    -- A second or third rendering is wanted, and nobody is at it.
    judge_wanted boolean NOT NULL DEFAULT false,
    -- Who rendered a completed job that nobody else has rendered the same.
    renderer text,
    -- Who rendered it to something else.
    contradictor text,
    failed_on text[] NOT NULL DEFAULT '{}',
    record text
) WITH (
    fillfactor = 85,
    -- Claims read the index of pending jobs from its start, where handed-out jobs leave dead
    -- entries behind: they go after so many changes, however large the table is.
    autovacuum_vacuum_scale_factor = 0,
    autovacuum_vacuum_threshold = 20000,
    autovacuum_vacuum_insert_scale_factor = 0.2,
    autovacuum_vacuum_cost_delay = 0,
    vacuum_index_cleanup = on
);

CREATE INDEX jobs_pending ON jobs (priority DESC, material) WHERE stage = 'pending';
CREATE INDEX jobs_failed ON jobs (priority DESC, material) WHERE stage = 'pending' AND failed_on <> '{}';
CREATE INDEX jobs_to_judge ON jobs (stage DESC, material) WHERE judge_wanted;
CREATE INDEX jobs_apart ON jobs (stage, material) WHERE stage IN ('disputed', 'set_aside', 'cancelled');
CREATE INDEX jobs_vouched ON jobs (renderer) WHERE renderer IS NOT NULL;
CREATE INDEX jobs_contradicted ON jobs (contradictor) WHERE contradictor IS NOT NULL;

-- Times are milliseconds of the database's clock. A renewal changes no indexed column and finds
-- room on its page, so that it leaves nothing behind but what the next visit of the page clears.
CREATE TABLE leases (
    material bigint PRIMARY KEY,
    token bytea NOT NULL,
    worker bytea NOT NULL,
    name text NOT NULL,
    claimed_ms bigint NOT NULL,
    expires_ms bigint NOT NULL,
    views_done bigint NOT NULL,
    progressed_ms bigint NOT NULL
) WITH (
    fillfactor = 50,
    autovacuum_vacuum_scale_factor = 0,
    autovacuum_vacuum_threshold = 5000,
    autovacuum_vacuum_cost_delay = 0,
    vacuum_index_cleanup = on
);

CREATE INDEX leases_of_workers ON leases (worker);
CREATE INDEX leases_of_names ON leases (name);

-- What is kept of workers by name.
CREATE TABLE workers (
    name text PRIMARY KEY,
    barred boolean NOT NULL,
    failing boolean NOT NULL,
    bar_ends_ms bigint,
    record text NOT NULL
);

CREATE INDEX workers_barred ON workers (name) WHERE barred;

-- Registrations, of all coordinators together.
CREATE TABLE sessions (
    worker bytea PRIMARY KEY,
    name text NOT NULL,
    seen_ms bigint NOT NULL
) WITH (fillfactor = 50);

CREATE INDEX sessions_of_names ON sessions (name);

CREATE VIEW able AS
    SELECT DISTINCT name FROM sessions
    WHERE NOT EXISTS (SELECT FROM workers WHERE workers.name = sessions.name AND barred);

-- The last completion of each material, whether or not it still counts, and which image a digest
-- names.
CREATE TABLE completions (
    material bigint PRIMARY KEY,
    completion text NOT NULL
);

CREATE TABLE images (
    digest bytea PRIMARY KEY,
    material bigint NOT NULL,
    view integer NOT NULL,
    bytes bigint NOT NULL
);

-- How many jobs are in which stage: the sum over all shards. A transaction counts in the shard of
-- its connection, so that connections do not wait for each other.
CREATE TABLE tallies (
    shard integer PRIMARY KEY,
    pending bigint NOT NULL DEFAULT 0,
    leased bigint NOT NULL DEFAULT 0,
    completed bigint NOT NULL DEFAULT 0,
    disputed bigint NOT NULL DEFAULT 0,
    set_aside bigint NOT NULL DEFAULT 0,
    cancelled bigint NOT NULL DEFAULT 0,
    checks bigint NOT NULL DEFAULT 0
) WITH (fillfactor = 10, autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 500);

INSERT INTO tallies (shard) SELECT generate_series(0, 63);

-- One row: what the dataset is, and whether work is handed out.
CREATE TABLE farm (
    one boolean PRIMARY KEY DEFAULT true CHECK (one),
    renderer_version text NOT NULL,
    specification_hash bytea NOT NULL,
    specification text NOT NULL,
    blobs text NOT NULL,
    mode text NOT NULL DEFAULT '"running"'
);

-- One row: when somebody last looked for leases that ran out.
CREATE TABLE sweeps (
    one boolean PRIMARY KEY DEFAULT true CHECK (one),
    swept_ms bigint NOT NULL
) WITH (fillfactor = 10, autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 200);

INSERT INTO sweeps (swept_ms) VALUES (0);

-- The one clock of all coordinators.
CREATE FUNCTION now_ms() RETURNS bigint LANGUAGE sql VOLATILE AS
    'SELECT (extract(epoch FROM clock_timestamp()) * 1000)::bigint';
