-- The manifest of an archive: its settings, bags and units. The other tables have the columns of
-- tables.py and history_rows.py.
CREATE SCHEMA manifest;

CREATE TABLE manifest.archive (
    version INTEGER NOT NULL, id VARCHAR NOT NULL, settings VARCHAR NOT NULL, sources VARCHAR[] NOT NULL,
    scan BIGINT NOT NULL
);

-- seen: the mark with which a bag was read. end_ns: log time of its last message.
CREATE TABLE manifest.bag (
    bag VARCHAR NOT NULL, bytes BIGINT NOT NULL, mark VARCHAR NOT NULL, beside VARCHAR NOT NULL,
    scan BIGINT NOT NULL, is_there BOOLEAN NOT NULL, state VARCHAR NOT NULL DEFAULT 'new',
    seen VARCHAR NOT NULL DEFAULT '', bag_sha256 VARCHAR NOT NULL DEFAULT '',
    software VARCHAR NOT NULL DEFAULT '', settings VARCHAR NOT NULL DEFAULT '',
    reason VARCHAR NOT NULL DEFAULT '', remarks VARCHAR NOT NULL DEFAULT '',
    windows INTEGER NOT NULL DEFAULT 0, valid INTEGER NOT NULL DEFAULT 0,
    end_ns BIGINT NOT NULL DEFAULT 0
);

-- A unit in a bag, with its numbers of rows. last_ns: stamp of the last of them.
CREATE TABLE manifest.part (
    bag VARCHAR NOT NULL, unit VARCHAR NOT NULL, model VARCHAR NOT NULL,
    calibration_id VARCHAR NOT NULL, last_ns BIGINT NOT NULL, estimates INTEGER NOT NULL,
    usage INTEGER NOT NULL, duty INTEGER NOT NULL
);

-- made_by, lost: what its health and life follow from, and why its newest test may be lost. windows and digest belong to its history: the
-- windows that it rests on, and their identity; none without windows.
CREATE TABLE manifest.unit (
    unit VARCHAR NOT NULL, actuator_id VARCHAR NOT NULL, serial_number VARCHAR NOT NULL,
    model VARCHAR NOT NULL, is_due BOOLEAN NOT NULL DEFAULT true, made_by VARCHAR NOT NULL DEFAULT '',
    lost VARCHAR NOT NULL DEFAULT '', windows INTEGER NOT NULL DEFAULT 0, digest VARCHAR NOT NULL DEFAULT ''
);

CREATE VIEW bags AS
SELECT
    bag, bytes, is_there, state, bag_sha256, software, settings, reason, remarks, windows, valid
FROM manifest.bag;

-- Bags that are not read as a whole. One that cannot be read counts until it is removed.
CREATE VIEW manifest.unread AS
SELECT * FROM manifest.bag
WHERE state = 'incomplete' OR (is_there AND state IN ('damaged', 'failed'));

-- Units whose tests these bags may hold: those read of the bag, or else those of its folder.
CREATE VIEW manifest.suspect AS
WITH nameless AS (
    SELECT bag, parse_dirpath(bag, 'forward_slash') AS folder
    FROM manifest.unread ANTI JOIN manifest.part USING (bag)
),
folders AS (SELECT DISTINCT parse_dirpath(bag, 'forward_slash') AS folder, unit FROM manifest.part)
SELECT bag, unit FROM manifest.unread JOIN manifest.part USING (bag)
UNION
SELECT bag, unit FROM nameless JOIN folders USING (folder);
