-- Views over the units of an archive. Levels: 0 OK, 1 WARN, 2 ERROR, 3 STALE.
CREATE VIEW latest_health AS SELECT * FROM units;

-- The worst first: by level, what is unknown before what is OK, then by the median of the remaining life, then by health.
CREATE VIEW worst_first AS
SELECT
    model, actuator_id, serial_number, ['OK', 'WARN', 'ERROR', 'STALE'][level + 1] AS health,
    ['OK', 'WARN', 'ERROR', 'STALE'][last_level + 1] AS last_health, dominant_fault, health_index, rul_known, rul_05, rul_50, rul_95, removal_hours, hours, tested,
    reason
FROM units
ORDER BY
    CASE level WHEN 3 THEN 0.5 ELSE level END DESC,
    CASE WHEN rul_known THEN rul_50 ELSE 'inf'::DOUBLE END,
    health_index, model, unit;
