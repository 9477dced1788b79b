-- Manifest of an archive: settings, bags and units. The columns of the other tables are defined in
-- tables.py and history_rows.py.
CREATE SCHEMA manifest;

CREATE TABLE manifest.archive (
    version INTEGER NOT NULL, id VARCHAR NOT NULL, settings VARCHAR NOT NULL, sources VARCHAR[] NOT NULL,
    scan BIGINT NOT NULL
);

-- mark: change mark at the last scan. seen: change mark of the content that was read.
-- calibration_url: address of the calibration in the same folder. end_ns: log time of the last message.
CREATE TABLE manifest.bag (
    bag VARCHAR NOT NULL, bytes BIGINT NOT NULL, mark VARCHAR NOT NULL,
    calibration_url VARCHAR NOT NULL, scan BIGINT NOT NULL, is_there BOOLEAN NOT NULL, state VARCHAR NOT NULL DEFAULT 'new',
    seen VARCHAR NOT NULL DEFAULT '', bag_sha256 VARCHAR NOT NULL DEFAULT '',
    software VARCHAR NOT NULL DEFAULT '', settings VARCHAR NOT NULL DEFAULT '',
    reason VARCHAR NOT NULL DEFAULT '', remarks VARCHAR NOT NULL DEFAULT '',
    windows INTEGER NOT NULL DEFAULT 0, valid INTEGER NOT NULL DEFAULT 0,
    end_ns BIGINT NOT NULL DEFAULT 0
);

-- Units in each bag, with the number of rows in each table. last_ns: timestamp of the last row.
CREATE TABLE manifest.part (
    bag VARCHAR NOT NULL, unit VARCHAR NOT NULL, model VARCHAR NOT NULL,
    calibration_id VARCHAR NOT NULL, last_ns BIGINT NOT NULL, estimates INTEGER NOT NULL,
    usage INTEGER NOT NULL, duty INTEGER NOT NULL
);

-- made_by: identity of the inputs to health and life. lost: why the newest test may be lost.
-- windows, digest: number and digest of the windows in the stored history; 0 and '' without one.
CREATE TABLE manifest.unit (
    unit VARCHAR NOT NULL, actuator_id VARCHAR NOT NULL, serial_number VARCHAR NOT NULL,
    model VARCHAR NOT NULL, is_due BOOLEAN NOT NULL DEFAULT true, made_by VARCHAR NOT NULL DEFAULT '',
    lost VARCHAR NOT NULL DEFAULT '', windows INTEGER NOT NULL DEFAULT 0, digest VARCHAR NOT NULL DEFAULT ''
);

CREATE VIEW bags AS
SELECT
    bag, bytes, is_there, state, bag_sha256, software, settings, reason, remarks, windows, valid
FROM manifest.bag;

-- Bags that were not read completely. An unreadable bag counts until it is removed from its source.
CREATE VIEW manifest.unread AS
SELECT * FROM manifest.bag
WHERE state = 'incomplete' OR (is_there AND state IN ('damaged', 'failed'));

-- Units whose tests may be in an unread bag: the units read from the bag, or else the units of other
-- bags in its folder.
CREATE VIEW manifest.suspect AS
WITH nameless AS (
    SELECT bag, parse_dirpath(bag, 'forward_slash') AS folder
    FROM manifest.unread ANTI JOIN manifest.part USING (bag)
),
folders AS (SELECT DISTINCT parse_dirpath(bag, 'forward_slash') AS folder, unit FROM manifest.part)
SELECT bag, unit FROM manifest.unread JOIN manifest.part USING (bag)
UNION
SELECT bag, unit FROM nameless JOIN folders USING (folder);
