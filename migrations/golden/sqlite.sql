CREATE TABLE action (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_action_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_action PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_action_kb_id_key UNIQUE (kb_id, "key")
);
CREATE TABLE action_node (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    parent INTEGER,
    operator VARCHAR(32) NOT NULL,
    predicate_id BIGINT,
    function_id BIGINT,
    value TEXT,
    CONSTRAINT ck_action_node_function_given CHECK ((operator = 'function') = (function_id IS NOT NULL)),
    CONSTRAINT ck_action_node_one_root CHECK ((parent IS NULL) = (position = 0)),
    CONSTRAINT ck_action_node_predicate_given CHECK ((operator = 'predicate') = (predicate_id IS NOT NULL)),
    CONSTRAINT ck_action_node_preorder CHECK (parent < position),
    CONSTRAINT ck_action_node_section CHECK (section IN ('duration', 'condition', 'effect')),
    CONSTRAINT fk_action_node_kb_id_function_id FOREIGN KEY(kb_id, function_id) REFERENCES function (kb_id, id),
    CONSTRAINT fk_action_node_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT fk_action_node_parent FOREIGN KEY(kb_id, action_id, since, section, parent) REFERENCES action_node (kb_id, action_id, since, section, position),
    CONSTRAINT fk_action_node_version FOREIGN KEY(kb_id, action_id, since) REFERENCES action_version (kb_id, action_id, since),
    CONSTRAINT pk_action_node PRIMARY KEY (kb_id, action_id, since, section, position)
);
CREATE INDEX ix_action_node_function ON action_node (kb_id, function_id);
CREATE INDEX ix_action_node_predicate ON action_node (kb_id, predicate_id);
CREATE TABLE action_parameter (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    name VARCHAR(255) NOT NULL,
    CONSTRAINT fk_action_parameter_kb_id_action_id_since FOREIGN KEY(kb_id, action_id, since) REFERENCES action_version (kb_id, action_id, since),
    CONSTRAINT pk_action_parameter PRIMARY KEY (kb_id, action_id, since, position)
);
CREATE TABLE action_parameter_type (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    alternative INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_action_parameter_type_kb_id_action_id_since_position FOREIGN KEY(kb_id, action_id, since, position) REFERENCES action_parameter (kb_id, action_id, since, position),
    CONSTRAINT fk_action_parameter_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT pk_action_parameter_type PRIMARY KEY (kb_id, action_id, since, position, alternative)
);
CREATE INDEX ix_action_parameter_type_type ON action_parameter_type (kb_id, type_id);
CREATE TABLE action_term (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    term INTEGER NOT NULL,
    parameter INTEGER,
    object_id BIGINT,
    quantifier INTEGER,
    variable INTEGER,
    child INTEGER,
    CONSTRAINT ck_action_term_bound CHECK ((quantifier IS NULL) = (variable IS NULL)),
    CONSTRAINT ck_action_term_one_of_four CHECK (CASE WHEN parameter IS NULL THEN 0 ELSE 1 END + CASE WHEN object_id IS NULL THEN 0 ELSE 1 END + CASE WHEN variable IS NULL THEN 0 ELSE 1 END + CASE WHEN child IS NULL THEN 0 ELSE 1 END = 1),
    CONSTRAINT fk_action_term_child FOREIGN KEY(kb_id, action_id, since, section, child) REFERENCES action_node (kb_id, action_id, since, section, position),
    CONSTRAINT fk_action_term_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_action_term_node FOREIGN KEY(kb_id, action_id, since, section, position) REFERENCES action_node (kb_id, action_id, since, section, position),
    CONSTRAINT fk_action_term_parameter FOREIGN KEY(kb_id, action_id, since, parameter) REFERENCES action_parameter (kb_id, action_id, since, position),
    CONSTRAINT fk_action_term_variable FOREIGN KEY(kb_id, action_id, since, section, quantifier, variable) REFERENCES action_variable (kb_id, action_id, since, section, position, variable),
    CONSTRAINT pk_action_term PRIMARY KEY (kb_id, action_id, since, section, position, term)
);
CREATE INDEX ix_action_term_object ON action_term (kb_id, object_id);
CREATE TABLE action_variable (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    variable INTEGER NOT NULL,
    name VARCHAR(255) NOT NULL,
    CONSTRAINT fk_action_variable_node FOREIGN KEY(kb_id, action_id, since, section, position) REFERENCES action_node (kb_id, action_id, since, section, position),
    CONSTRAINT pk_action_variable PRIMARY KEY (kb_id, action_id, since, section, position, variable)
);
CREATE TABLE action_variable_type (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    variable INTEGER NOT NULL,
    alternative INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_action_variable_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_action_variable_type_variable FOREIGN KEY(kb_id, action_id, since, section, position, variable) REFERENCES action_variable (kb_id, action_id, since, section, position, variable),
    CONSTRAINT pk_action_variable_type PRIMARY KEY (kb_id, action_id, since, section, position, variable, alternative)
);
CREATE INDEX ix_action_variable_type_type ON action_variable_type (kb_id, type_id);
CREATE TABLE action_version (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    text TEXT NOT NULL,
    kind VARCHAR(16) DEFAULT 'action' NOT NULL,
    CONSTRAINT ck_action_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_action_version_kb_id_action_id FOREIGN KEY(kb_id, action_id) REFERENCES action (kb_id, id),
    CONSTRAINT fk_action_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_action_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_action_version PRIMARY KEY (kb_id, action_id, since)
);
CREATE INDEX ix_action_version_since ON action_version (kb_id, since, action_id);
CREATE INDEX ix_action_version_until ON action_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_action_version_live ON action_version (kb_id, action_id) WHERE until IS NULL;
CREATE TABLE archive (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    revision BIGINT NOT NULL,
    target TEXT NOT NULL,
    versions BIGINT NOT NULL,
    rest TEXT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT fk_archive_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT fk_archive_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_archive_upto FOREIGN KEY(kb_id, revision) REFERENCES revision (kb_id, number),
    CONSTRAINT pk_archive PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_archive_revision ON archive (kb_id, revision);
CREATE INDEX ix_archive_since ON archive (kb_id, since);
CREATE VIEW audit_action AS
SELECT
    k.name AS knowledge_base,
    a.name AS action,
    v.action_id,
    v.kind AS kind,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM action_version AS v
LEFT JOIN action AS a ON a.kb_id = v.kb_id AND likelihood(a.id = v.action_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_action_literal AS
SELECT
    k.name AS knowledge_base,
    a.name AS action,
    n.action_id,
    v.kind AS kind,
    n.section AS section,
    n.position,
    (
        WITH RECURSIVE walk (position, above, is_denied, asserted, denied, time, is_need) AS (
            SELECT n.position, n.parent, 0, 0, 0, CAST(NULL AS varchar(32)),
                CASE WHEN n.section = 'condition' THEN 1 ELSE 0 END
            UNION ALL
            SELECT m.position, m.parent,
                CASE WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN 1 - walk.is_denied ELSE walk.is_denied END,
                CASE WHEN m.operator IN ('or', 'imply', 'exists', 'forall', 'when', 'preference')
                    THEN 1 WHEN m.operator = 'not' THEN walk.denied ELSE walk.asserted END,
                CASE WHEN m.operator IN ('and', 'exists', 'forall', 'when', 'preference') THEN 1
                    WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN walk.asserted ELSE walk.denied END,
                CASE WHEN m.operator IN ('at start', 'over all', 'at end')
                    THEN m.operator ELSE walk.time END,
                CASE WHEN m.operator = 'when' AND walk.position = m.position + 1
                    THEN 1 ELSE walk.is_need END
            FROM walk
            JOIN action_node AS m ON m.kb_id = n.kb_id AND m.action_id = n.action_id AND m.since = n.since AND m.section = n.section
                AND m.position = walk.above
        )
        SELECT CASE WHEN is_need = 1
            THEN CASE WHEN is_denied = 0 THEN CAST('needs' AS TEXT) ELSE CAST('needs not' AS TEXT) END
            ELSE CASE WHEN is_denied = 0 THEN CAST('adds' AS TEXT) ELSE CAST('deletes' AS TEXT) END END FROM walk WHERE above IS NULL
    ) AS role,
    d.name AS predicate,
    (
        WITH RECURSIVE spell (position, term, text) AS (
            SELECT n.position, 0, '(' || d.name
            UNION ALL
            SELECT
                CASE WHEN t.child IS NOT NULL THEN t.child
                    WHEN t.term IS NULL THEN o.position ELSE spell.position END,
                CASE WHEN t.child IS NOT NULL THEN 0
                    WHEN t.term IS NULL THEN o.term + 1 ELSE spell.term + 1 END,
                spell.text || CASE WHEN t.term IS NULL THEN ')'
                    WHEN t.child IS NOT NULL THEN ' (' || (
                        SELECT f.name FROM action_node AS c
                        JOIN function AS f ON f.kb_id = c.kb_id AND f.id = c.function_id
                        WHERE c.kb_id = n.kb_id AND c.action_id = n.action_id AND c.since = n.since AND c.section = n.section AND c.position = t.child
                    )
                    WHEN t.object_id IS NOT NULL THEN ' ' || (
                        SELECT e.name FROM object AS e
                        WHERE e.kb_id = n.kb_id AND e.id = t.object_id
                    )
                    WHEN t.parameter IS NOT NULL THEN ' ?' || (
                        SELECT q.name FROM action_parameter AS q
                        WHERE q.kb_id = n.kb_id AND q.action_id = n.action_id AND q.since = n.since AND q.position = t.parameter
                    )
                    ELSE ' ?' || (
                        SELECT b.name FROM action_variable AS b
                        WHERE b.kb_id = n.kb_id AND b.action_id = n.action_id AND b.since = n.since AND b.section = n.section
                            AND b.position = t.quantifier AND b.variable = t.variable
                    ) END
            FROM spell
            LEFT JOIN action_term AS t ON t.kb_id = n.kb_id AND t.action_id = n.action_id AND t.since = n.since AND t.section = n.section
                AND t.position = spell.position AND t.term = spell.term
            LEFT JOIN action_term AS o ON t.term IS NULL AND o.kb_id = n.kb_id AND o.action_id = n.action_id AND o.since = n.since
                AND o.section = n.section AND o.child = spell.position
            WHERE spell.position IS NOT NULL
        )
        SELECT text FROM spell WHERE position IS NULL
    ) AS literal,
    (
        WITH RECURSIVE walk (position, above, is_denied, asserted, denied, time, is_need) AS (
            SELECT n.position, n.parent, 0, 0, 0, CAST(NULL AS varchar(32)),
                CASE WHEN n.section = 'condition' THEN 1 ELSE 0 END
            UNION ALL
            SELECT m.position, m.parent,
                CASE WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN 1 - walk.is_denied ELSE walk.is_denied END,
                CASE WHEN m.operator IN ('or', 'imply', 'exists', 'forall', 'when', 'preference')
                    THEN 1 WHEN m.operator = 'not' THEN walk.denied ELSE walk.asserted END,
                CASE WHEN m.operator IN ('and', 'exists', 'forall', 'when', 'preference') THEN 1
                    WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN walk.asserted ELSE walk.denied END,
                CASE WHEN m.operator IN ('at start', 'over all', 'at end')
                    THEN m.operator ELSE walk.time END,
                CASE WHEN m.operator = 'when' AND walk.position = m.position + 1
                    THEN 1 ELSE walk.is_need END
            FROM walk
            JOIN action_node AS m ON m.kb_id = n.kb_id AND m.action_id = n.action_id AND m.since = n.since AND m.section = n.section
                AND m.position = walk.above
        )
        SELECT time FROM walk WHERE above IS NULL
    ) AS time,
    (
        WITH RECURSIVE walk (position, above, is_denied, asserted, denied, time, is_need) AS (
            SELECT n.position, n.parent, 0, 0, 0, CAST(NULL AS varchar(32)),
                CASE WHEN n.section = 'condition' THEN 1 ELSE 0 END
            UNION ALL
            SELECT m.position, m.parent,
                CASE WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN 1 - walk.is_denied ELSE walk.is_denied END,
                CASE WHEN m.operator IN ('or', 'imply', 'exists', 'forall', 'when', 'preference')
                    THEN 1 WHEN m.operator = 'not' THEN walk.denied ELSE walk.asserted END,
                CASE WHEN m.operator IN ('and', 'exists', 'forall', 'when', 'preference') THEN 1
                    WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN walk.asserted ELSE walk.denied END,
                CASE WHEN m.operator IN ('at start', 'over all', 'at end')
                    THEN m.operator ELSE walk.time END,
                CASE WHEN m.operator = 'when' AND walk.position = m.position + 1
                    THEN 1 ELSE walk.is_need END
            FROM walk
            JOIN action_node AS m ON m.kb_id = n.kb_id AND m.action_id = n.action_id AND m.since = n.since AND m.section = n.section
                AND m.position = walk.above
        )
        SELECT asserted = 1 FROM walk WHERE above IS NULL
    ) AS is_conditional,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    n.kb_id
FROM action_node AS n
JOIN action_version AS v ON v.kb_id = n.kb_id AND v.action_id = n.action_id AND v.since = n.since
LEFT JOIN action AS a ON a.kb_id = n.kb_id AND a.id = n.action_id
LEFT JOIN predicate AS d ON d.kb_id = n.kb_id AND d.id = n.predicate_id
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
WHERE n.predicate_id IS NOT NULL;
CREATE VIEW audit_archive AS
SELECT
    k.name AS knowledge_base,
    v.id AS archive_id,
    v.revision,
    r.committed_at AS revision_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS revision_epoch,
    v.target,
    v.versions,
    v.rest,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.kb_id
FROM archive AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_change AS
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('type' AS TEXT) AS kind,
    v.text AS text,
    v.type_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM type_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('object' AS TEXT) AS kind,
    v.text AS text,
    v.object_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM object_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('predicate' AS TEXT) AS kind,
    v.text AS text,
    v.predicate_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM predicate_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('function' AS TEXT) AS kind,
    v.text AS text,
    v.function_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM function_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('action' AS TEXT) AS kind,
    v.text AS text,
    v.action_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM action_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    v.section AS kind,
    v.text AS text,
    v.formula_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM formula_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('document' AS TEXT) AS kind,
    v.text AS text,
    v.document_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM document_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('fact' AS TEXT) AS kind,
    p.text AS text,
    v.proposition_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM proposition_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
WHERE NOT v.is_goal
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('goal' AS TEXT) AS kind,
    p.text AS text,
    v.proposition_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM proposition_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
WHERE v.is_goal = 1
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('value' AS TEXT) AS kind,
    v.text AS text,
    v.function_value_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM function_value_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('plan' AS TEXT) AS kind,
    v.text AS text,
    v.id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM plan AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    v.kind AS kind,
    v.text AS text,
    CAST(CASE v.plan_id WHEN 0 THEN v.position ELSE v.plan_id END AS bigint) AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM execution_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('archive' AS TEXT) AS kind,
    v.text AS text,
    v.id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM archive AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('type' AS TEXT) AS kind,
    v.text AS text,
    v.type_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM type_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('object' AS TEXT) AS kind,
    v.text AS text,
    v.object_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM object_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('predicate' AS TEXT) AS kind,
    v.text AS text,
    v.predicate_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM predicate_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('function' AS TEXT) AS kind,
    v.text AS text,
    v.function_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM function_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('action' AS TEXT) AS kind,
    v.text AS text,
    v.action_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM action_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    v.section AS kind,
    v.text AS text,
    v.formula_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM formula_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('document' AS TEXT) AS kind,
    v.text AS text,
    v.document_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM document_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('fact' AS TEXT) AS kind,
    p.text AS text,
    v.proposition_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM proposition_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE NOT v.is_goal AND v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('goal' AS TEXT) AS kind,
    p.text AS text,
    v.proposition_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM proposition_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.is_goal = 1 AND COALESCE(v.until, 0) > 0
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('value' AS TEXT) AS kind,
    v.text AS text,
    v.function_value_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM function_value_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    v.kind AS kind,
    v.text AS text,
    CAST(CASE v.plan_id WHEN 0 THEN v.position ELSE v.plan_id END AS bigint) AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM execution_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('promotion' AS TEXT) AS kind,
    v.text AS text,
    v.id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM promotion AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('confirmation' AS TEXT) AS kind,
    p.text AS text,
    v.proposition_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM confirmation AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('rule' AS TEXT) AS kind,
    v.text AS text,
    v.rule_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM rule_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.until AS revision,
    CAST('-' AS TEXT) AS sign,
    CAST('rule' AS TEXT) AS kind,
    v.text AS text,
    v.rule_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM rule_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.until
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.until, 0.01)
WHERE v.until IS NOT NULL
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('saying' AS TEXT) AS kind,
    v.text AS text,
    v.proposition_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM proposition_saying AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('saying' AS TEXT) AS kind,
    v.text AS text,
    v.function_value_id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM function_value_saying AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01)
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    CAST('+' AS TEXT) AS sign,
    CAST('erasure' AS TEXT) AS kind,
    v.text AS text,
    v.id AS element_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM erasure AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01);
CREATE VIEW audit_confirmation AS
SELECT
    k.name AS knowledge_base,
    v.since AS revision,
    p.text AS text,
    v.proposition_id AS proposition_id,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    v.kb_id
FROM confirmation AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.since
LEFT JOIN revision_execution AS x ON x.kb_id = v.kb_id AND likelihood(x.number = v.since, 0.01);
CREATE VIEW audit_definition AS
SELECT
    k.name AS knowledge_base,
    CAST('type' AS TEXT) AS kind,
    n.name,
    v.type_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM type_version AS v
LEFT JOIN type AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.type_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
SELECT
    k.name AS knowledge_base,
    CAST('object' AS TEXT) AS kind,
    n.name,
    v.object_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM object_version AS v
LEFT JOIN object AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.object_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
SELECT
    k.name AS knowledge_base,
    CAST('predicate' AS TEXT) AS kind,
    n.name,
    v.predicate_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM predicate_version AS v
LEFT JOIN predicate AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.predicate_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
SELECT
    k.name AS knowledge_base,
    CAST('function' AS TEXT) AS kind,
    n.name,
    v.function_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM function_version AS v
LEFT JOIN function AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.function_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
SELECT
    k.name AS knowledge_base,
    CAST('action' AS TEXT) AS kind,
    n.name,
    v.action_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM action_version AS v
LEFT JOIN action AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.action_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
SELECT
    k.name AS knowledge_base,
    v.section AS kind,
    n.name,
    v.formula_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM formula_version AS v
LEFT JOIN formula AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.formula_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
SELECT
    k.name AS knowledge_base,
    CAST('document' AS TEXT) AS kind,
    n.name,
    v.document_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM document_version AS v
LEFT JOIN document AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.document_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
SELECT
    k.name AS knowledge_base,
    CAST('rule' AS TEXT) AS kind,
    n.name,
    v.rule_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM rule_version AS v
LEFT JOIN rule AS n ON n.kb_id = v.kb_id AND likelihood(n.id = v.rule_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_effect AS
SELECT
    k.name AS knowledge_base,
    v.execution,
    v.plan_id,
    v.position,
    v.proposition_id,
    p.text,
    v.since,
    v.since_at,
    (strftime('%s', substr(v.since_at, 1, 19)) * 1000000 + substr(v.since_at, 21, 6)) / 1000000.0 AS since_epoch,
    v.asserted_by,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.actor AS retracted_by,
    v.confirmed,
    r.committed_at AS confirmed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS confirmed_epoch,
    r.actor AS confirmed_by,
    v.kb_id
FROM (
    SELECT
        w.kb_id,
        CASE WHEN w.plan_id = 0 THEN w.position || ''
            ELSE w.plan_id || '.' || w.position END AS execution,
        w.plan_id,
        w.position,
        f.proposition_id,
        f.since,
        f.until,
        s.committed_at AS since_at,
        s.actor AS asserted_by,
        (
            SELECT max(c.since)
            FROM confirmation AS c
            JOIN revision AS q ON q.kb_id = c.kb_id AND q.number = c.since
            WHERE c.kb_id = f.kb_id AND c.proposition_id = f.proposition_id
                AND c.since > f.since AND (f.until IS NULL OR c.since <= f.until)
                AND COALESCE(q.actor, '') <> COALESCE(s.actor, '')
        ) AS confirmed
    FROM (
        SELECT kb_id, plan_id, position, since FROM execution_version
        WHERE outcome IN ('running', 'succeeded')
        UNION
        SELECT kb_id, plan_id, position, number FROM revision_execution
    ) AS w
    JOIN proposition_version AS f ON f.kb_id = w.kb_id AND f.since = w.since
    JOIN revision AS s ON s.kb_id = f.kb_id AND s.number = f.since
    WHERE NOT f.is_goal
) AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.confirmed;
CREATE VIEW audit_erasure AS
SELECT
    k.name AS knowledge_base,
    v.id AS erasure_id,
    v.revision,
    r.committed_at AS revision_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS revision_epoch,
    v.kind,
    v.element_id,
    v.pseudonym,
    v.parts,
    v.digest,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.kb_id
FROM erasure AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_execution AS
SELECT
    k.name AS knowledge_base,
    v.execution,
    v.plan_id,
    v.position,
    v.action,
    v.arguments,
    v.text,
    v.outcome,
    v.code,
    v.message,
    v.started,
    v.started_at,
    (strftime('%s', substr(v.started_at, 1, 19)) * 1000000 + substr(v.started_at, 21, 6)) / 1000000.0 AS started_epoch,
    v.started_by,
    v.started_reason,
    v.started_source AS started_source,
    v.ended,
    v.ended_at,
    (strftime('%s', substr(v.ended_at, 1, 19)) * 1000000 + substr(v.ended_at, 21, 6)) / 1000000.0 AS ended_epoch,
    v.ended_by,
    v.ended_reason,
    ((strftime('%s', substr(v.ended_at, 1, 19)) - strftime('%s', substr(v.started_at, 1, 19))) * 1000000 + substr(v.ended_at, 21, 6) - substr(v.started_at, 21, 6)) / 1000000.0 AS duration,
    CAST(v.planned_duration AS REAL) AS planned_duration,
    v.kb_id
FROM (
    SELECT
        e.kb_id,
        CASE WHEN e.plan_id = 0 THEN e.position || ''
            ELSE e.plan_id || '.' || e.position END AS execution,
        e.plan_id,
        e.position,
        COALESCE(a.name, e.name) AS action,
        CASE WHEN e.name IS NULL THEN rtrim(substr(e.text, length(a.name) + 3), ')') ELSE (
            SELECT group_concat(h.said, ' ')
            FROM (
                SELECT COALESCE(o.name, g.value) AS said
                FROM execution_argument AS g
                LEFT JOIN object AS o ON o.kb_id = g.kb_id AND o.id = g.object_id
                WHERE g.kb_id = e.kb_id AND g.plan_id = e.plan_id AND g.position = e.position
                ORDER BY g.argument
            ) AS h
        ) END AS arguments,
        e.text,
        w.outcome AS outcome,
        w.code,
        w.message,
        CASE e.plan_id WHEN 0 THEN e.since ELSE b.since END AS started,
        COALESCE(w.started_at, s.committed_at) AS started_at,
        s.actor AS started_by,
        s.reason AS started_reason,
        s.source AS started_source,
        u.number AS ended,
        CASE WHEN u.number IS NOT NULL THEN COALESCE(w.ended_at, u.committed_at) END AS ended_at,
        u.actor AS ended_by,
        u.reason AS ended_reason,
        e.duration AS planned_duration
    FROM execution AS e
    JOIN execution_version AS w ON w.kb_id = e.kb_id AND w.plan_id = e.plan_id
        AND w.position = e.position AND w.until IS NULL
    LEFT JOIN execution_version AS b ON b.kb_id = e.kb_id AND b.plan_id = e.plan_id
        AND b.position = e.position AND b.since = (
            SELECT min(c.since) FROM execution_version AS c
            WHERE c.kb_id = e.kb_id AND c.plan_id = e.plan_id AND c.position = e.position
        )
    LEFT JOIN action AS a ON a.kb_id = e.kb_id AND likelihood(a.id = e.action_id, 0.01)
    LEFT JOIN revision AS s ON s.kb_id = e.kb_id
        AND s.number = CASE e.plan_id WHEN 0 THEN e.since ELSE b.since END
    LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.since AND w.outcome <> 'running'
) AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05);
CREATE VIEW audit_fact AS
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN CAST('goal' AS TEXT) ELSE CAST('fact' AS TEXT) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM proposition_version AS v
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND likelihood(d.id = v.predicate_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_fact_argument AS
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN CAST('goal' AS TEXT) ELSE CAST('fact' AS TEXT) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    p.text,
    a.position,
    (
        SELECT m.name
        FROM predicate_version AS w
        JOIN predicate_parameter AS m ON m.kb_id = w.kb_id
            AND m.predicate_id = w.predicate_id AND m.since = w.since
        WHERE w.kb_id = v.kb_id AND w.predicate_id = v.predicate_id AND w.since <= v.since
            AND (w.until IS NULL OR w.until > v.since) AND m.position = a.position
    ) AS parameter,
    o.name AS object,
    a.object_id,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM proposition_version AS v
JOIN proposition_argument AS a ON a.kb_id = v.kb_id AND likelihood(a.proposition_id = v.proposition_id, 0.01)
LEFT JOIN object AS o ON o.kb_id = a.kb_id AND likelihood(o.id = a.object_id, 0.01)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND likelihood(d.id = v.predicate_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_fact_valid AS
SELECT
    k.name AS knowledge_base,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text,
    v.valid_from,
    (strftime('%s', substr(v.valid_from, 1, 19)) * 1000000 + substr(v.valid_from, 21, 6)) / 1000000.0 AS valid_from_epoch,
    v.valid_until,
    (strftime('%s', substr(v.valid_until, 1, 19)) * 1000000 + substr(v.valid_until, 21, 6)) / 1000000.0 AS valid_until_epoch,
    v.known_since,
    s.committed_at AS known_since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS known_since_epoch,
    s.actor AS known_by,
    s.reason AS known_reason,
    v.known_until,
    u.committed_at AS known_until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS known_until_epoch,
    u.actor AS corrected_by,
    u.reason AS corrected_reason,
    v.kb_id
FROM (
    SELECT
        w.kb_id, w.proposition_id, w.predicate_id, 
        s.committed_at AS valid_from,
        u.committed_at AS valid_until,
        w.since AS known_since,
        CAST(NULL AS bigint) AS known_until
    FROM proposition_version AS w
    JOIN revision AS s ON s.kb_id = w.kb_id AND s.number = w.since
    LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
    WHERE NOT w.is_goal AND COALESCE(s.committed_at < u.committed_at, w.until IS NULL) AND NOT EXISTS (
        SELECT 1 FROM proposition_saying AS l
        WHERE l.kb_id = w.kb_id AND l.proposition_id = w.proposition_id
    )
    UNION ALL
    SELECT
        w.kb_id, w.proposition_id, w.predicate_id, 
        u.committed_at AS valid_from,
        NULL AS valid_until,
        w.since AS known_since,
        w.until AS known_until
    FROM proposition_version AS w
    JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
    WHERE NOT w.is_goal
    UNION ALL
    SELECT
        w.kb_id, w.proposition_id, w.predicate_id, 
        w.valid_from,
        w.valid_until,
        w.since AS known_since,
        w.known_until
    FROM (
        SELECT
            e.*,
            g.valid_from,
            g.valid_until,
            lead(e.since) OVER (
                PARTITION BY e.kb_id, e.proposition_id, g.valid_from ORDER BY e.since
            ) AS known_until
        FROM (
            SELECT
                m.kb_id,
                m.proposition_id,
                m.moment AS valid_from,
                lead(m.moment) OVER (
                    PARTITION BY m.kb_id, m.proposition_id ORDER BY m.moment
                ) AS valid_until
            FROM (
                SELECT l.kb_id, l.proposition_id, l.valid_from AS moment FROM proposition_saying AS l
                UNION
                SELECT l.kb_id, l.proposition_id, l.valid_until FROM proposition_saying AS l
                UNION
                SELECT n.kb_id, n.proposition_id, q.committed_at
                FROM proposition_version AS n
                JOIN revision AS q ON q.kb_id = n.kb_id AND q.number IN (n.since, n.until)
                WHERE EXISTS (
                    SELECT 1 FROM proposition_saying AS l
                    WHERE l.kb_id = n.kb_id AND l.proposition_id = n.proposition_id
                )
            ) AS m
        ) AS g
        JOIN (
            SELECT
                l.kb_id, l.proposition_id, l.predicate_id,  l.since,
                l.valid_from AS begun, l.valid_until AS ended, l.holds AS holds
            FROM proposition_saying AS l
            UNION ALL
            SELECT
                w.kb_id, w.proposition_id, w.predicate_id,  w.since,
                s.committed_at, u.committed_at, TRUE
            FROM proposition_version AS w
            JOIN revision AS s ON s.kb_id = w.kb_id AND s.number = w.since
            LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
            WHERE NOT w.is_goal AND EXISTS (
                SELECT 1 FROM proposition_saying AS l
                WHERE l.kb_id = w.kb_id AND l.proposition_id = w.proposition_id
            )
        ) AS e ON e.kb_id = g.kb_id AND e.proposition_id = g.proposition_id
            AND e.begun <= g.valid_from AND COALESCE(g.valid_from < e.ended, TRUE)
    ) AS w
    WHERE w.holds
) AS v
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND likelihood(d.id = v.predicate_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.known_since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.known_until;
CREATE VIEW audit_goal AS
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN CAST('goal' AS TEXT) ELSE CAST('fact' AS TEXT) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM proposition_version AS v
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.proposition_id, 0.01)
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND likelihood(d.id = v.predicate_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
WHERE v.is_goal = 1;
CREATE VIEW audit_knowledge_base AS
SELECT
    k.name AS knowledge_base,
    h.revision,
    h.committed_at,
    (strftime('%s', substr(h.committed_at, 1, 19)) * 1000000 + substr(h.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    h.origin,
    c.revision AS verified_revision,
    c.verified_at,
    h.kb_id
FROM head AS h
JOIN knowledge_base AS k ON k.id = h.kb_id
LEFT JOIN verification AS c ON c.kb_id = h.kb_id;
CREATE VIEW audit_object AS
SELECT
    k.name AS knowledge_base,
    o.name AS object,
    v.object_id,
    CASE WHEN v.is_constant
        THEN substr(v.text, length(o.name) + 16, length(v.text) - length(o.name) - 16)
        ELSE substr(v.text, length(o.name) + 4) END AS type,
    v.is_constant,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM object_version AS v
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND likelihood(o.id = v.object_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_plan AS
SELECT
    k.name AS knowledge_base,
    v.id AS plan_id,
    v.revision,
    r.committed_at AS revision_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS revision_epoch,
    v.problem_hash,
    v.planner,
    v.planner_version,
    v.objective,
    v.value,
    CAST(v.value AS REAL) AS number,
    v.status,
    (
        SELECT count(w.kb_id) FROM execution AS w WHERE w.kb_id = v.kb_id AND w.plan_id = v.id
    ) AS steps,
    (
        SELECT count(w.kb_id) FROM execution_version AS w
        WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome = 'running'
    ) AS steps_running,
    (
        SELECT count(w.kb_id) FROM execution_version AS w
        WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome = 'succeeded'
    ) AS steps_succeeded,
    (
        SELECT count(w.kb_id) FROM execution_version AS w
        WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome = 'failed'
    ) AS steps_failed,
    (
        SELECT count(w.kb_id) FROM execution_version AS w
        WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome = 'aborted'
    ) AS steps_aborted,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.domain_pddl,
    v.problem_pddl,
    v.kb_id
FROM plan AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_plan_step AS
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    a.name AS action,
    rtrim(substr(v.text, length(a.name) + 3), ')') AS arguments,
    v.text,
    CAST(v.start AS REAL) AS planned_start,
    CAST(v.duration AS REAL) AS planned_duration,
    w.outcome AS status,
    b.since AS started,
    s.committed_at AS started_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS started_epoch,
    s.actor AS started_by,
    u.number AS ended,
    u.committed_at AS ended_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS ended_epoch,
    u.actor AS ended_by,
    u.reason AS ended_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    (
        SELECT count(x.kb_id) FROM revision_execution AS x
        WHERE x.kb_id = v.kb_id AND x.plan_id = v.plan_id AND x.position = v.position
    ) AS revisions,
    v.kb_id
FROM execution AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN action AS a ON a.kb_id = v.kb_id AND likelihood(a.id = v.action_id, 0.01)
LEFT JOIN execution_version AS w ON w.kb_id = v.kb_id AND w.plan_id = v.plan_id
    AND w.position = v.position AND w.until IS NULL
LEFT JOIN execution_version AS b ON b.kb_id = v.kb_id AND b.plan_id = v.plan_id
    AND b.position = v.position AND b.since = (
        SELECT max(c.since) FROM execution_version AS c
        WHERE c.kb_id = v.kb_id AND c.plan_id = v.plan_id AND c.position = v.position
            AND c.outcome = 'running'
    )
LEFT JOIN revision AS s ON s.kb_id = b.kb_id AND s.number = b.since
LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.since AND w.outcome <> 'running'
WHERE v.plan_id > 0;
CREATE VIEW audit_plan_step_argument AS
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    p.text,
    v.argument,
    o.name AS object,
    v.object_id,
    v.kb_id
FROM execution_argument AS v
LEFT JOIN execution AS p ON p.kb_id = v.kb_id AND p.plan_id = v.plan_id AND p.position = v.position
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND likelihood(o.id = v.object_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
WHERE v.plan_id > 0;
CREATE VIEW audit_plan_step_status AS
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    v.outcome AS status,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM execution_version AS v
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
WHERE v.plan_id > 0;
CREATE VIEW audit_promotion AS
SELECT
    k.name AS knowledge_base,
    v.id AS promotion_id,
    v.revision,
    r.committed_at AS revision_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS revision_epoch,
    v.origin,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.kb_id
FROM promotion AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_revision AS
SELECT
    k.name AS knowledge_base,
    r.number AS revision,
    r.committed_at,
    (strftime('%s', substr(r.committed_at, 1, 19)) * 1000000 + substr(r.committed_at, 21, 6)) / 1000000.0 AS committed_epoch,
    substr(r.committed_at, 1, 13) AS committed_hour,
    r.observed_at,
    (strftime('%s', substr(r.observed_at, 1, 19)) * 1000000 + substr(r.observed_at, 21, 6)) / 1000000.0 AS observed_epoch,
    ((strftime('%s', substr(r.committed_at, 1, 19)) - strftime('%s', substr(r.observed_at, 1, 19))) * 1000000 + substr(r.committed_at, 21, 6) - substr(r.observed_at, 21, 6)) / 1000000.0 AS delay,
    r.actor,
    r.reason,
    r.source AS source,
    x.plan_id,
    x.position AS plan_step,
    r.form,
    r.hash,
    r.kb_id
FROM revision AS r
LEFT JOIN knowledge_base AS k ON likelihood(k.id = r.kb_id, 0.05)
LEFT JOIN revision_execution AS x ON x.kb_id = r.kb_id AND x.number = r.number;
CREATE VIEW audit_statistics AS
SELECT
    k.name AS knowledge_base,
    s.action,
    s.arguments,
    s.executions,
    s.running,
    s.succeeded,
    s.failed,
    s.aborted,
    s.refused,
    CAST(s.succeeded AS REAL) / s.decided AS success_rate,
    CASE s.succeeded WHEN 0 THEN CAST(s.failed AS REAL) / s.decided - 1 ELSE
        (s.succeeded + 1.920729410347062 - 1.959963984540054 * s.spread)
        / (s.decided + 3.841458820694124) END AS success_low,
    CASE s.failed WHEN 0 THEN CAST(s.succeeded AS REAL) / s.decided ELSE
        (s.succeeded + 1.920729410347062 + 1.959963984540054 * s.spread)
        / (s.decided + 3.841458820694124) END AS success_high,
    s.mean,
    s.median,
    s.percentile_95,
    s.codes,
    s.kb_id,
    s.unconfirmed
FROM (
    SELECT
        g.*,
        NULLIF(g.succeeded + g.failed, 0) AS decided,
        (
            WITH RECURSIVE near (step, square, root) AS (
                SELECT 1, of.square, of.square FROM (
                    SELECT CAST(g.succeeded AS REAL) * g.failed / NULLIF(g.succeeded + g.failed, 0)
                        + 0.960364705173531 AS square
                ) AS of
                UNION ALL
                SELECT near.step + 1, near.square, (near.root + near.square / near.root) / 2
                FROM near WHERE near.step < 40
            )
            SELECT near.root FROM near WHERE near.step = 40
        ) AS spread
    FROM (
        SELECT
            p.knowledge_base,
            p.action,
            p.arguments,
            count(*) AS executions,
            count(CASE p.outcome WHEN 'running' THEN 1 END) AS running,
            count(CASE p.outcome WHEN 'succeeded' THEN 1 END) AS succeeded,
            count(CASE p.outcome WHEN 'failed' THEN 1 END) AS failed,
            count(CASE p.outcome WHEN 'aborted' THEN 1 END) AS aborted,
            count(CASE p.outcome WHEN 'refused' THEN 1 END) AS refused,
            avg(p.duration) AS mean,
            avg(CASE WHEN p.place IN ((p.timed + 1) / 2, (p.timed + 2) / 2)
                THEN p.duration END) AS median,
            max(CASE WHEN p.place = (95 * p.timed + 99) / 100 THEN p.duration END)
                AS percentile_95,
            group_concat(p.failures, ', ') AS codes,
            CAST(COALESCE(sum(p.unconfirmed), 0) AS bigint) AS unconfirmed,
            p.kb_id
        FROM (
            SELECT
                e.*,
                row_number() OVER (PARTITION BY e.kb_id, e.action, e.arguments, e.duration IS NULL
                    ORDER BY e.duration) AS place,
                count(e.duration) OVER (PARTITION BY e.kb_id, e.action, e.arguments) AS timed,
                CASE row_number() OVER (PARTITION BY e.kb_id, e.action, e.arguments, e.code)
                    WHEN 1 THEN e.code || ': ' || count(*) OVER (
                        PARTITION BY e.kb_id, e.action, e.arguments, e.code) END AS failures
            FROM (
        SELECT
            v.knowledge_base, v.kb_id, v.action, NULL AS arguments, v.outcome, v.code, u.unconfirmed,
            CASE WHEN v.outcome IN ('succeeded', 'failed') THEN v.duration END AS duration
        FROM audit_execution AS v
        LEFT JOIN (
            SELECT e.kb_id, e.plan_id, e.position, count(*) AS unconfirmed
            FROM audit_effect AS e
            WHERE e.until IS NULL AND e.confirmed IS NULL
            GROUP BY e.kb_id, e.plan_id, e.position
        ) AS u ON u.kb_id = v.kb_id AND u.plan_id = v.plan_id AND u.position = v.position
        UNION ALL
        SELECT
            v.knowledge_base, v.kb_id, v.action, COALESCE(v.arguments, '') AS arguments, v.outcome, v.code, u.unconfirmed,
            CASE WHEN v.outcome IN ('succeeded', 'failed') THEN v.duration END AS duration
        FROM audit_execution AS v
        LEFT JOIN (
            SELECT e.kb_id, e.plan_id, e.position, count(*) AS unconfirmed
            FROM audit_effect AS e
            WHERE e.until IS NULL AND e.confirmed IS NULL
            GROUP BY e.kb_id, e.plan_id, e.position
        ) AS u ON u.kb_id = v.kb_id AND u.plan_id = v.plan_id AND u.position = v.position
            ) AS e
        ) AS p
        GROUP BY p.kb_id, p.knowledge_base, p.action, p.arguments
    ) AS g
) AS s
LEFT JOIN knowledge_base AS k ON likelihood(k.id = s.kb_id, 0.05);
CREATE VIEW audit_value AS
SELECT
    k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    rtrim(substr(f.text, length(d.name) + 3), ')') AS arguments,
    f.text AS fluent,
    COALESCE(v.value, o.name) AS value,
    v.number,
    v.text,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM function_value_version AS v
LEFT JOIN function_value AS f ON f.kb_id = v.kb_id AND likelihood(f.id = v.function_value_id, 0.01)
LEFT JOIN function AS d ON d.kb_id = v.kb_id AND likelihood(d.id = v.function_id, 0.01)
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND likelihood(o.id = v.object_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_value_argument AS
SELECT
    k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    v.text,
    a.position,
    (
        SELECT m.name
        FROM function_version AS w
        JOIN function_parameter AS m ON m.kb_id = w.kb_id
            AND m.function_id = w.function_id AND m.since = w.since
        WHERE w.kb_id = v.kb_id AND w.function_id = v.function_id AND w.since <= v.since
            AND (w.until IS NULL OR w.until > v.since) AND m.position = a.position
    ) AS parameter,
    o.name AS object,
    a.object_id,
    v.since,
    s.committed_at AS since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    ((strftime('%s', substr(u.committed_at, 1, 19)) - strftime('%s', substr(s.committed_at, 1, 19))) * 1000000 + substr(u.committed_at, 21, 6) - substr(s.committed_at, 21, 6)) / 1000000.0 AS duration,
    v.kb_id
FROM function_value_version AS v
JOIN function_value_argument AS a ON a.kb_id = v.kb_id
    AND likelihood(a.function_value_id = v.function_value_id, 0.01)
LEFT JOIN object AS o ON o.kb_id = a.kb_id AND likelihood(o.id = a.object_id, 0.01)
LEFT JOIN function AS d ON d.kb_id = v.kb_id AND likelihood(d.id = v.function_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_value_valid AS
SELECT
    k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text AS fluent,
    COALESCE(v.value, o.name) AS value,
    v.number,
    v.valid_from,
    (strftime('%s', substr(v.valid_from, 1, 19)) * 1000000 + substr(v.valid_from, 21, 6)) / 1000000.0 AS valid_from_epoch,
    v.valid_until,
    (strftime('%s', substr(v.valid_until, 1, 19)) * 1000000 + substr(v.valid_until, 21, 6)) / 1000000.0 AS valid_until_epoch,
    v.known_since,
    s.committed_at AS known_since_at,
    (strftime('%s', substr(s.committed_at, 1, 19)) * 1000000 + substr(s.committed_at, 21, 6)) / 1000000.0 AS known_since_epoch,
    s.actor AS known_by,
    s.reason AS known_reason,
    v.known_until,
    u.committed_at AS known_until_at,
    (strftime('%s', substr(u.committed_at, 1, 19)) * 1000000 + substr(u.committed_at, 21, 6)) / 1000000.0 AS known_until_epoch,
    u.actor AS corrected_by,
    u.reason AS corrected_reason,
    v.kb_id
FROM (
    SELECT
        w.kb_id, w.function_value_id, w.function_id, w.value, w.number, w.object_id,
        s.committed_at AS valid_from,
        u.committed_at AS valid_until,
        w.since AS known_since,
        CAST(NULL AS bigint) AS known_until
    FROM function_value_version AS w
    JOIN revision AS s ON s.kb_id = w.kb_id AND s.number = w.since
    LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
    WHERE TRUE AND COALESCE(s.committed_at < u.committed_at, w.until IS NULL) AND NOT EXISTS (
        SELECT 1 FROM function_value_saying AS l
        WHERE l.kb_id = w.kb_id AND l.function_value_id = w.function_value_id
    )
    UNION ALL
    SELECT
        w.kb_id, w.function_value_id, w.function_id, w.value, w.number, w.object_id,
        u.committed_at AS valid_from,
        NULL AS valid_until,
        w.since AS known_since,
        w.until AS known_until
    FROM function_value_version AS w
    JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
    WHERE TRUE
    UNION ALL
    SELECT
        w.kb_id, w.function_value_id, w.function_id, w.value, w.number, w.object_id,
        w.valid_from,
        w.valid_until,
        w.since AS known_since,
        w.known_until
    FROM (
        SELECT
            e.*,
            g.valid_from,
            g.valid_until,
            lead(e.since) OVER (
                PARTITION BY e.kb_id, e.function_value_id, g.valid_from ORDER BY e.since
            ) AS known_until
        FROM (
            SELECT
                m.kb_id,
                m.function_value_id,
                m.moment AS valid_from,
                lead(m.moment) OVER (
                    PARTITION BY m.kb_id, m.function_value_id ORDER BY m.moment
                ) AS valid_until
            FROM (
                SELECT l.kb_id, l.function_value_id, l.valid_from AS moment FROM function_value_saying AS l
                UNION
                SELECT l.kb_id, l.function_value_id, l.valid_until FROM function_value_saying AS l
                UNION
                SELECT n.kb_id, n.function_value_id, q.committed_at
                FROM function_value_version AS n
                JOIN revision AS q ON q.kb_id = n.kb_id AND q.number IN (n.since, n.until)
                WHERE EXISTS (
                    SELECT 1 FROM function_value_saying AS l
                    WHERE l.kb_id = n.kb_id AND l.function_value_id = n.function_value_id
                )
            ) AS m
        ) AS g
        JOIN (
            SELECT
                l.kb_id, l.function_value_id, l.function_id, l.value, l.number, l.object_id, l.since,
                l.valid_from AS begun, l.valid_until AS ended, (l.number IS NOT NULL OR l.object_id IS NOT NULL) AS holds
            FROM function_value_saying AS l
            UNION ALL
            SELECT
                w.kb_id, w.function_value_id, w.function_id, w.value, w.number, w.object_id, w.since,
                s.committed_at, u.committed_at, TRUE
            FROM function_value_version AS w
            JOIN revision AS s ON s.kb_id = w.kb_id AND s.number = w.since
            LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
            WHERE TRUE AND EXISTS (
                SELECT 1 FROM function_value_saying AS l
                WHERE l.kb_id = w.kb_id AND l.function_value_id = w.function_value_id
            )
        ) AS e ON e.kb_id = g.kb_id AND e.function_value_id = g.function_value_id
            AND e.begun <= g.valid_from AND COALESCE(g.valid_from < e.ended, TRUE)
    ) AS w
    WHERE w.holds
) AS v
LEFT JOIN function_value AS p ON p.kb_id = v.kb_id AND likelihood(p.id = v.function_value_id, 0.01)
LEFT JOIN function AS d ON d.kb_id = v.kb_id AND likelihood(d.id = v.function_id, 0.01)
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND likelihood(o.id = v.object_id, 0.01)
LEFT JOIN knowledge_base AS k ON likelihood(k.id = v.kb_id, 0.05)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.known_since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.known_until;
CREATE TABLE commitment (
    kb_id BIGINT NOT NULL,
    number BIGINT NOT NULL,
    position INTEGER NOT NULL,
    sign VARCHAR(1) NOT NULL,
    kind VARCHAR(20) NOT NULL,
    owner_id BIGINT NOT NULL,
    place INTEGER NOT NULL,
    salt BLOB,
    commitment TEXT,
    erasure_id BIGINT,
    CONSTRAINT ck_commitment_commitment_of_erased CHECK ((commitment IS NULL) = (erasure_id IS NULL)),
    CONSTRAINT ck_commitment_kept_or_erased CHECK ((salt IS NULL) <> (erasure_id IS NULL)),
    CONSTRAINT fk_commitment_kb_id_number FOREIGN KEY(kb_id, number) REFERENCES revision (kb_id, number),
    CONSTRAINT pk_commitment PRIMARY KEY (kb_id, number, position)
);
CREATE INDEX ix_commitment_erasure ON commitment (kb_id, erasure_id) WHERE erasure_id IS NOT NULL;
CREATE TABLE confirmation (
    kb_id BIGINT NOT NULL,
    proposition_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    CONSTRAINT fk_confirmation_kb_id_proposition_id FOREIGN KEY(kb_id, proposition_id) REFERENCES proposition (kb_id, id),
    CONSTRAINT fk_confirmation_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_confirmation PRIMARY KEY (kb_id, proposition_id, since)
)
 WITHOUT ROWID;
CREATE INDEX ix_confirmation_since ON confirmation (kb_id, since);
CREATE TABLE document (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT ck_document_domain_or_problem CHECK (key IN ('domain', 'problem')),
    CONSTRAINT fk_document_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_document PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_document_kb_id_key UNIQUE (kb_id, "key")
);
CREATE TABLE document_item (
    kb_id BIGINT NOT NULL,
    document_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    name TEXT NOT NULL,
    CONSTRAINT fk_document_item_kb_id_document_id_since FOREIGN KEY(kb_id, document_id, since) REFERENCES document_version (kb_id, document_id, since),
    CONSTRAINT pk_document_item PRIMARY KEY (kb_id, document_id, since, section, position)
);
CREATE TABLE document_version (
    kb_id BIGINT NOT NULL,
    document_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    title VARCHAR(255) NOT NULL,
    domain VARCHAR(255),
    text TEXT NOT NULL,
    CONSTRAINT ck_document_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_document_version_kb_id_document_id FOREIGN KEY(kb_id, document_id) REFERENCES document (kb_id, id),
    CONSTRAINT fk_document_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_document_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_document_version PRIMARY KEY (kb_id, document_id, since)
);
CREATE INDEX ix_document_version_since ON document_version (kb_id, since, document_id);
CREATE INDEX ix_document_version_until ON document_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_document_version_live ON document_version (kb_id, document_id) WHERE until IS NULL;
CREATE TABLE erasure (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    revision BIGINT NOT NULL,
    kind VARCHAR(16) NOT NULL,
    element_id BIGINT,
    pseudonym TEXT NOT NULL,
    parts BIGINT NOT NULL,
    digest TEXT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT fk_erasure_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT fk_erasure_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_erasure_upto FOREIGN KEY(kb_id, revision) REFERENCES revision (kb_id, number),
    CONSTRAINT pk_erasure PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_erasure_revision ON erasure (kb_id, revision);
CREATE INDEX ix_erasure_since ON erasure (kb_id, since);
CREATE TABLE execution (
    kb_id BIGINT NOT NULL,
    plan_id BIGINT NOT NULL,
    position INTEGER NOT NULL,
    since BIGINT NOT NULL,
    start TEXT,
    duration TEXT,
    action_id BIGINT,
    name TEXT,
    text TEXT NOT NULL,
    CONSTRAINT ck_execution_action_or_name CHECK ((action_id IS NULL) <> (name IS NULL)),
    CONSTRAINT fk_execution_kb_id_action_id FOREIGN KEY(kb_id, action_id) REFERENCES action (kb_id, id),
    CONSTRAINT pk_execution PRIMARY KEY (kb_id, plan_id, position)
)
 WITHOUT ROWID;
CREATE INDEX ix_execution_action ON execution (kb_id, action_id);
CREATE INDEX ix_execution_name ON execution (kb_id, name) WHERE name IS NOT NULL;
CREATE TABLE execution_argument (
    kb_id BIGINT NOT NULL,
    plan_id BIGINT NOT NULL,
    position INTEGER NOT NULL,
    argument INTEGER NOT NULL,
    object_id BIGINT,
    value TEXT,
    CONSTRAINT ck_execution_argument_object_or_value CHECK ((object_id IS NULL) <> (value IS NULL)),
    CONSTRAINT fk_execution_argument_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_execution_argument_kb_id_plan_id_position FOREIGN KEY(kb_id, plan_id, position) REFERENCES execution (kb_id, plan_id, position),
    CONSTRAINT pk_execution_argument PRIMARY KEY (kb_id, plan_id, position, argument)
)
 WITHOUT ROWID;
CREATE INDEX ix_execution_argument_object ON execution_argument (kb_id, object_id);
CREATE TABLE execution_version (
    kb_id BIGINT NOT NULL,
    plan_id BIGINT NOT NULL,
    position INTEGER NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    kind VARCHAR(16) NOT NULL,
    outcome VARCHAR(16) NOT NULL,
    code TEXT,
    message TEXT,
    started_at VARCHAR(27),
    ended_at VARCHAR(27),
    text TEXT NOT NULL,
    CONSTRAINT ck_execution_version_kind CHECK (kind IN ('execution', 'plan step')),
    CONSTRAINT ck_execution_version_outcome CHECK (outcome IN ('running', 'succeeded', 'failed', 'aborted', 'refused')),
    CONSTRAINT ck_execution_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_execution_version_kb_id_plan_id_position FOREIGN KEY(kb_id, plan_id, position) REFERENCES execution (kb_id, plan_id, position),
    CONSTRAINT fk_execution_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_execution_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_execution_version PRIMARY KEY (kb_id, plan_id, position, since)
)
 WITHOUT ROWID;
CREATE INDEX ix_execution_version_running ON execution_version (kb_id, outcome, plan_id, position, until) WHERE until IS NULL AND outcome = 'running';
CREATE INDEX ix_execution_version_since ON execution_version (kb_id, since);
CREATE INDEX ix_execution_version_until ON execution_version (kb_id, until) WHERE until IS NOT NULL;
CREATE TABLE formula (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_formula_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_formula PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_formula_kb_id_key UNIQUE (kb_id, "key")
);
CREATE TABLE formula_node (
    kb_id BIGINT NOT NULL,
    formula_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    parent INTEGER,
    operator VARCHAR(32) NOT NULL,
    predicate_id BIGINT,
    function_id BIGINT,
    value TEXT,
    CONSTRAINT ck_formula_node_function_given CHECK ((operator = 'function') = (function_id IS NOT NULL)),
    CONSTRAINT ck_formula_node_one_root CHECK ((parent IS NULL) = (position = 0)),
    CONSTRAINT ck_formula_node_predicate_given CHECK ((operator = 'predicate') = (predicate_id IS NOT NULL)),
    CONSTRAINT ck_formula_node_preorder CHECK (parent < position),
    CONSTRAINT fk_formula_node_kb_id_function_id FOREIGN KEY(kb_id, function_id) REFERENCES function (kb_id, id),
    CONSTRAINT fk_formula_node_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT fk_formula_node_parent FOREIGN KEY(kb_id, formula_id, since, section, parent) REFERENCES formula_node (kb_id, formula_id, since, section, position),
    CONSTRAINT fk_formula_node_version FOREIGN KEY(kb_id, formula_id, since) REFERENCES formula_version (kb_id, formula_id, since),
    CONSTRAINT pk_formula_node PRIMARY KEY (kb_id, formula_id, since, section, position)
);
CREATE INDEX ix_formula_node_function ON formula_node (kb_id, function_id);
CREATE INDEX ix_formula_node_predicate ON formula_node (kb_id, predicate_id);
CREATE TABLE formula_term (
    kb_id BIGINT NOT NULL,
    formula_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    term INTEGER NOT NULL,
    parameter INTEGER,
    object_id BIGINT,
    quantifier INTEGER,
    variable INTEGER,
    child INTEGER,
    CONSTRAINT ck_formula_term_bound CHECK ((quantifier IS NULL) = (variable IS NULL)),
    CONSTRAINT ck_formula_term_no_parameter CHECK (parameter IS NULL),
    CONSTRAINT ck_formula_term_one_of_four CHECK (CASE WHEN parameter IS NULL THEN 0 ELSE 1 END + CASE WHEN object_id IS NULL THEN 0 ELSE 1 END + CASE WHEN variable IS NULL THEN 0 ELSE 1 END + CASE WHEN child IS NULL THEN 0 ELSE 1 END = 1),
    CONSTRAINT fk_formula_term_child FOREIGN KEY(kb_id, formula_id, since, section, child) REFERENCES formula_node (kb_id, formula_id, since, section, position),
    CONSTRAINT fk_formula_term_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_formula_term_node FOREIGN KEY(kb_id, formula_id, since, section, position) REFERENCES formula_node (kb_id, formula_id, since, section, position),
    CONSTRAINT fk_formula_term_variable FOREIGN KEY(kb_id, formula_id, since, section, quantifier, variable) REFERENCES formula_variable (kb_id, formula_id, since, section, position, variable),
    CONSTRAINT pk_formula_term PRIMARY KEY (kb_id, formula_id, since, section, position, term)
);
CREATE INDEX ix_formula_term_object ON formula_term (kb_id, object_id);
CREATE TABLE formula_variable (
    kb_id BIGINT NOT NULL,
    formula_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    variable INTEGER NOT NULL,
    name VARCHAR(255) NOT NULL,
    CONSTRAINT fk_formula_variable_node FOREIGN KEY(kb_id, formula_id, since, section, position) REFERENCES formula_node (kb_id, formula_id, since, section, position),
    CONSTRAINT pk_formula_variable PRIMARY KEY (kb_id, formula_id, since, section, position, variable)
);
CREATE TABLE formula_variable_type (
    kb_id BIGINT NOT NULL,
    formula_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    variable INTEGER NOT NULL,
    alternative INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_formula_variable_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_formula_variable_type_variable FOREIGN KEY(kb_id, formula_id, since, section, position, variable) REFERENCES formula_variable (kb_id, formula_id, since, section, position, variable),
    CONSTRAINT pk_formula_variable_type PRIMARY KEY (kb_id, formula_id, since, section, position, variable, alternative)
);
CREATE INDEX ix_formula_variable_type_type ON formula_variable_type (kb_id, type_id);
CREATE TABLE formula_version (
    kb_id BIGINT NOT NULL,
    formula_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    section VARCHAR(24) NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT ck_formula_version_section CHECK (section IN ('derived', 'domain constraint', 'initial', 'timed', 'goal', 'constraint', 'metric')),
    CONSTRAINT ck_formula_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_formula_version_kb_id_formula_id FOREIGN KEY(kb_id, formula_id) REFERENCES formula (kb_id, id),
    CONSTRAINT fk_formula_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_formula_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_formula_version PRIMARY KEY (kb_id, formula_id, since)
);
CREATE INDEX ix_formula_version_since ON formula_version (kb_id, since, formula_id);
CREATE INDEX ix_formula_version_until ON formula_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_formula_version_live ON formula_version (kb_id, formula_id) WHERE until IS NULL;
CREATE TABLE function (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_function_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_function PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_function_kb_id_key UNIQUE (kb_id, "key")
);
CREATE INDEX ix_function_name ON function (name);
CREATE TABLE function_parameter (
    kb_id BIGINT NOT NULL,
    function_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    name VARCHAR(255) NOT NULL,
    CONSTRAINT fk_function_parameter_kb_id_function_id_since FOREIGN KEY(kb_id, function_id, since) REFERENCES function_version (kb_id, function_id, since),
    CONSTRAINT pk_function_parameter PRIMARY KEY (kb_id, function_id, since, position)
);
CREATE TABLE function_parameter_type (
    kb_id BIGINT NOT NULL,
    function_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    alternative INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_function_parameter_type_kb_id_function_id_since_position FOREIGN KEY(kb_id, function_id, since, position) REFERENCES function_parameter (kb_id, function_id, since, position),
    CONSTRAINT fk_function_parameter_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT pk_function_parameter_type PRIMARY KEY (kb_id, function_id, since, position, alternative)
);
CREATE INDEX ix_function_parameter_type_type ON function_parameter_type (kb_id, type_id);
CREATE TABLE function_type (
    kb_id BIGINT NOT NULL,
    function_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_function_type_kb_id_function_id_since FOREIGN KEY(kb_id, function_id, since) REFERENCES function_version (kb_id, function_id, since),
    CONSTRAINT fk_function_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT pk_function_type PRIMARY KEY (kb_id, function_id, since, position)
);
CREATE INDEX ix_function_type_type ON function_type (kb_id, type_id);
CREATE TABLE function_value (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    function_id BIGINT NOT NULL,
    arguments TEXT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT fk_function_value_kb_id_function_id FOREIGN KEY(kb_id, function_id) REFERENCES function (kb_id, id),
    CONSTRAINT pk_function_value PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_function_value_fluent UNIQUE (kb_id, function_id, arguments)
);
CREATE INDEX ix_function_value_text ON function_value (text);
CREATE TABLE function_value_argument (
    kb_id BIGINT NOT NULL,
    function_value_id BIGINT NOT NULL,
    position INTEGER NOT NULL,
    object_id BIGINT NOT NULL,
    CONSTRAINT fk_function_value_argument_kb_id_function_value_id FOREIGN KEY(kb_id, function_value_id) REFERENCES function_value (kb_id, id),
    CONSTRAINT fk_function_value_argument_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT pk_function_value_argument PRIMARY KEY (kb_id, function_value_id, position)
);
CREATE INDEX ix_function_value_argument_object ON function_value_argument (kb_id, object_id, function_value_id);
CREATE TABLE function_value_saying (
    kb_id BIGINT NOT NULL,
    function_value_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    valid_from VARCHAR(27) NOT NULL,
    valid_until VARCHAR(27) NOT NULL,
    function_id BIGINT NOT NULL,
    value TEXT,
    number DOUBLE,
    object_id BIGINT,
    fork BIGINT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT ck_function_value_saying_number_of_value CHECK ((value IS NULL) = (number IS NULL)),
    CONSTRAINT ck_function_value_saying_period CHECK (valid_from < valid_until),
    CONSTRAINT ck_function_value_saying_value_or_object CHECK (value IS NULL OR object_id IS NULL),
    CONSTRAINT fk_function_value_saying_kb_id_function_value_id FOREIGN KEY(kb_id, function_value_id) REFERENCES function_value (kb_id, id),
    CONSTRAINT fk_function_value_saying_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_function_value_saying_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_function_value_saying PRIMARY KEY (kb_id, function_value_id, since)
)
 WITHOUT ROWID;
CREATE INDEX ix_function_value_saying_object ON function_value_saying (kb_id, object_id) WHERE object_id IS NOT NULL;
CREATE INDEX ix_function_value_saying_since ON function_value_saying (kb_id, since);
CREATE INDEX ix_function_value_saying_valid ON function_value_saying (kb_id, function_id, fork, valid_from);
CREATE TABLE function_value_version (
    kb_id BIGINT NOT NULL,
    function_value_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    function_id BIGINT NOT NULL,
    value TEXT,
    number DOUBLE,
    object_id BIGINT,
    text TEXT NOT NULL,
    fork BIGINT DEFAULT 0 NOT NULL,
    CONSTRAINT ck_function_value_version_number_of_value CHECK ((value IS NULL) = (number IS NULL)),
    CONSTRAINT ck_function_value_version_since_before_until CHECK (since < until),
    CONSTRAINT ck_function_value_version_value_or_object CHECK ((value IS NULL) <> (object_id IS NULL)),
    CONSTRAINT fk_function_value_version_kb_id_function_id FOREIGN KEY(kb_id, function_id) REFERENCES function (kb_id, id),
    CONSTRAINT fk_function_value_version_kb_id_function_value_id FOREIGN KEY(kb_id, function_value_id) REFERENCES function_value (kb_id, id),
    CONSTRAINT fk_function_value_version_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_function_value_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_function_value_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_function_value_version PRIMARY KEY (kb_id, function_value_id, since)
);
CREATE INDEX ix_function_value_version_history ON function_value_version (kb_id, function_id, fork, since, until, function_value_id);
CREATE INDEX ix_function_value_version_now ON function_value_version (kb_id, function_id, function_value_id, until) WHERE until IS NULL;
CREATE INDEX ix_function_value_version_object ON function_value_version (kb_id, object_id) WHERE object_id IS NOT NULL;
CREATE INDEX ix_function_value_version_since ON function_value_version (kb_id, since);
CREATE INDEX ix_function_value_version_until ON function_value_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_function_value_version_live ON function_value_version (kb_id, function_value_id) WHERE until IS NULL;
CREATE TABLE function_version (
    kb_id BIGINT NOT NULL,
    function_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    text TEXT NOT NULL,
    CONSTRAINT ck_function_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_function_version_kb_id_function_id FOREIGN KEY(kb_id, function_id) REFERENCES function (kb_id, id),
    CONSTRAINT fk_function_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_function_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_function_version PRIMARY KEY (kb_id, function_id, since)
);
CREATE INDEX ix_function_version_since ON function_version (kb_id, since, function_id);
CREATE INDEX ix_function_version_until ON function_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_function_version_live ON function_version (kb_id, function_id) WHERE until IS NULL;
CREATE TABLE head (
    kb_id BIGINT NOT NULL,
    revision BIGINT NOT NULL,
    definition_revision BIGINT NOT NULL,
    next_id BIGINT NOT NULL,
    hash TEXT,
    committed_at VARCHAR(27),
    archived_revision BIGINT DEFAULT 0 NOT NULL,
    origin TEXT,
    origin_revision BIGINT,
    origin_committed_at VARCHAR(27),
    heard_at VARCHAR(27),
    CONSTRAINT fk_head_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_head PRIMARY KEY (kb_id)
);
CREATE TABLE kant_sql_version (
    version_num VARCHAR(32) NOT NULL,
    CONSTRAINT kant_sql_version_pkc PRIMARY KEY (version_num)
);
CREATE TABLE knowledge_base (
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    CONSTRAINT pk_knowledge_base PRIMARY KEY (id),
    CONSTRAINT uq_knowledge_base_name UNIQUE (name)
);
CREATE TABLE object (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_object_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_object PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_object_kb_id_key UNIQUE (kb_id, "key")
);
CREATE INDEX ix_object_name ON object (name);
CREATE TABLE object_type (
    kb_id BIGINT NOT NULL,
    object_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_object_type_kb_id_object_id_since FOREIGN KEY(kb_id, object_id, since) REFERENCES object_version (kb_id, object_id, since),
    CONSTRAINT fk_object_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT pk_object_type PRIMARY KEY (kb_id, object_id, since, position)
);
CREATE INDEX ix_object_type_type ON object_type (kb_id, type_id);
CREATE TABLE object_version (
    kb_id BIGINT NOT NULL,
    object_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    type_id BIGINT NOT NULL,
    text TEXT NOT NULL,
    is_constant BOOLEAN DEFAULT 0 NOT NULL,
    CONSTRAINT ck_object_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_object_version_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_object_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_object_version_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_object_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_object_version PRIMARY KEY (kb_id, object_id, since)
);
CREATE INDEX ix_object_version_since ON object_version (kb_id, since, object_id);
CREATE INDEX ix_object_version_until ON object_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_object_version_live ON object_version (kb_id, object_id) WHERE until IS NULL;
CREATE TABLE "plan" (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    revision BIGINT NOT NULL,
    problem_hash TEXT NOT NULL,
    planner TEXT,
    planner_version TEXT,
    objective TEXT,
    value TEXT,
    status TEXT,
    domain_pddl TEXT,
    problem_pddl TEXT,
    text TEXT NOT NULL,
    CONSTRAINT fk_plan_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT fk_plan_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_plan_problem FOREIGN KEY(kb_id, revision) REFERENCES revision (kb_id, number),
    CONSTRAINT pk_plan PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_plan_revision ON "plan" (kb_id, revision);
CREATE INDEX ix_plan_since ON "plan" (kb_id, since);
CREATE TABLE predicate (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_predicate_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_predicate PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_predicate_kb_id_key UNIQUE (kb_id, "key")
);
CREATE INDEX ix_predicate_name ON predicate (name);
CREATE TABLE predicate_parameter (
    kb_id BIGINT NOT NULL,
    predicate_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    name VARCHAR(255) NOT NULL,
    CONSTRAINT fk_predicate_parameter_kb_id_predicate_id_since FOREIGN KEY(kb_id, predicate_id, since) REFERENCES predicate_version (kb_id, predicate_id, since),
    CONSTRAINT pk_predicate_parameter PRIMARY KEY (kb_id, predicate_id, since, position)
);
CREATE TABLE predicate_parameter_type (
    kb_id BIGINT NOT NULL,
    predicate_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    alternative INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_predicate_parameter_type_kb_id_predicate_id_since_position FOREIGN KEY(kb_id, predicate_id, since, position) REFERENCES predicate_parameter (kb_id, predicate_id, since, position),
    CONSTRAINT fk_predicate_parameter_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT pk_predicate_parameter_type PRIMARY KEY (kb_id, predicate_id, since, position, alternative)
);
CREATE INDEX ix_predicate_parameter_type_type ON predicate_parameter_type (kb_id, type_id);
CREATE TABLE predicate_version (
    kb_id BIGINT NOT NULL,
    predicate_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    text TEXT NOT NULL,
    CONSTRAINT ck_predicate_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_predicate_version_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT fk_predicate_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_predicate_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_predicate_version PRIMARY KEY (kb_id, predicate_id, since)
);
CREATE INDEX ix_predicate_version_since ON predicate_version (kb_id, since, predicate_id);
CREATE INDEX ix_predicate_version_until ON predicate_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_predicate_version_live ON predicate_version (kb_id, predicate_id) WHERE until IS NULL;
CREATE TABLE promotion (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    revision BIGINT NOT NULL,
    origin TEXT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT fk_promotion_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT fk_promotion_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_promotion_last FOREIGN KEY(kb_id, revision) REFERENCES revision (kb_id, number),
    CONSTRAINT pk_promotion PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_promotion_revision ON promotion (kb_id, revision);
CREATE INDEX ix_promotion_since ON promotion (kb_id, since);
CREATE TABLE proposition (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    predicate_id BIGINT NOT NULL,
    is_goal BOOLEAN NOT NULL,
    arguments TEXT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT fk_proposition_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT pk_proposition PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_proposition_atom UNIQUE (kb_id, is_goal, predicate_id, arguments)
);
CREATE INDEX ix_proposition_text ON proposition (text);
CREATE TABLE proposition_argument (
    kb_id BIGINT NOT NULL,
    proposition_id BIGINT NOT NULL,
    position INTEGER NOT NULL,
    object_id BIGINT NOT NULL,
    CONSTRAINT fk_proposition_argument_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_proposition_argument_kb_id_proposition_id FOREIGN KEY(kb_id, proposition_id) REFERENCES proposition (kb_id, id),
    CONSTRAINT pk_proposition_argument PRIMARY KEY (kb_id, proposition_id, position)
);
CREATE INDEX ix_proposition_argument_object ON proposition_argument (kb_id, object_id, proposition_id);
CREATE TABLE proposition_saying (
    kb_id BIGINT NOT NULL,
    proposition_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    valid_from VARCHAR(27) NOT NULL,
    valid_until VARCHAR(27) NOT NULL,
    predicate_id BIGINT NOT NULL,
    holds BOOLEAN NOT NULL,
    first_object_id BIGINT,
    second_object_id BIGINT,
    fork BIGINT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT ck_proposition_saying_period CHECK (valid_from < valid_until),
    CONSTRAINT fk_proposition_saying_kb_id_proposition_id FOREIGN KEY(kb_id, proposition_id) REFERENCES proposition (kb_id, id),
    CONSTRAINT fk_proposition_saying_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_proposition_saying PRIMARY KEY (kb_id, proposition_id, since)
)
 WITHOUT ROWID;
CREATE INDEX ix_proposition_saying_first ON proposition_saying (kb_id, predicate_id, first_object_id, fork, valid_from) WHERE first_object_id IS NOT NULL;
CREATE INDEX ix_proposition_saying_second ON proposition_saying (kb_id, predicate_id, second_object_id, fork, valid_from) WHERE second_object_id IS NOT NULL;
CREATE INDEX ix_proposition_saying_since ON proposition_saying (kb_id, since);
CREATE INDEX ix_proposition_saying_valid ON proposition_saying (kb_id, predicate_id, fork, valid_from);
CREATE TABLE proposition_version (
    kb_id BIGINT NOT NULL,
    proposition_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    predicate_id BIGINT NOT NULL,
    is_goal BOOLEAN DEFAULT 0 NOT NULL,
    fork BIGINT DEFAULT 0 NOT NULL,
    first_object_id BIGINT,
    second_object_id BIGINT,
    CONSTRAINT ck_proposition_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_proposition_version_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_proposition_id FOREIGN KEY(kb_id, proposition_id) REFERENCES proposition (kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_proposition_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_proposition_version PRIMARY KEY (kb_id, proposition_id, since)
);
CREATE INDEX ix_proposition_version_goal ON proposition_version (kb_id, until, since, proposition_id, is_goal) WHERE is_goal = 1;
CREATE INDEX ix_proposition_version_goal_history ON proposition_version (kb_id, fork, since, until, proposition_id) WHERE is_goal = 1;
CREATE INDEX ix_proposition_version_goal_since ON proposition_version (kb_id, since) WHERE is_goal = 1;
CREATE INDEX ix_proposition_version_history ON proposition_version (kb_id, predicate_id, fork, first_object_id, since, until, proposition_id);
CREATE INDEX ix_proposition_version_history_second ON proposition_version (kb_id, predicate_id, fork, second_object_id, since, until, proposition_id) WHERE second_object_id IS NOT NULL;
CREATE INDEX ix_proposition_version_now ON proposition_version (kb_id, predicate_id, is_goal, first_object_id, second_object_id, proposition_id, until) WHERE until IS NULL;
CREATE INDEX ix_proposition_version_second ON proposition_version (kb_id, predicate_id, is_goal, second_object_id, first_object_id, proposition_id, until) WHERE until IS NULL AND second_object_id IS NOT NULL;
CREATE INDEX ix_proposition_version_since ON proposition_version (kb_id, since);
CREATE INDEX ix_proposition_version_until ON proposition_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_proposition_version_live ON proposition_version (proposition_id, kb_id) WHERE until IS NULL;
CREATE TABLE replacement (
    kb_id BIGINT NOT NULL,
    number BIGINT NOT NULL,
    position INTEGER NOT NULL,
    erasure_id BIGINT NOT NULL,
    salt BLOB,
    commitment TEXT,
    CONSTRAINT ck_replacement_salt_or_commitment CHECK ((salt IS NULL) <> (commitment IS NULL)),
    CONSTRAINT fk_replacement_kb_id_number_position FOREIGN KEY(kb_id, number, position) REFERENCES commitment (kb_id, number, position),
    CONSTRAINT pk_replacement PRIMARY KEY (kb_id, number, position, erasure_id)
)
 WITHOUT ROWID;
CREATE INDEX ix_replacement_erasure ON replacement (kb_id, erasure_id);
CREATE TABLE request (
    kb_id BIGINT NOT NULL,
    "key" TEXT NOT NULL,
    number BIGINT NOT NULL,
    digest TEXT NOT NULL,
    results TEXT NOT NULL,
    CONSTRAINT fk_request_kb_id_number FOREIGN KEY(kb_id, number) REFERENCES revision (kb_id, number),
    CONSTRAINT pk_request PRIMARY KEY (kb_id, "key")
);
CREATE INDEX ix_request_number ON request (kb_id, number);
CREATE TABLE revision (
    kb_id BIGINT NOT NULL,
    number BIGINT NOT NULL,
    committed_at VARCHAR(27) NOT NULL,
    actor TEXT,
    reason TEXT,
    source TEXT,
    form INTEGER NOT NULL,
    hash TEXT NOT NULL,
    observed_at VARCHAR(27),
    seed BLOB,
    CONSTRAINT ck_revision_number_positive CHECK (number > 0),
    CONSTRAINT fk_revision_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_revision PRIMARY KEY (kb_id, number)
);
CREATE INDEX ix_revision_committed_at ON revision (kb_id, committed_at);
CREATE TABLE revision_execution (
    kb_id BIGINT NOT NULL,
    number BIGINT NOT NULL,
    plan_id BIGINT NOT NULL,
    position INTEGER NOT NULL,
    CONSTRAINT fk_revision_execution_kb_id_number FOREIGN KEY(kb_id, number) REFERENCES revision (kb_id, number),
    CONSTRAINT fk_revision_execution_kb_id_plan_id_position FOREIGN KEY(kb_id, plan_id, position) REFERENCES execution (kb_id, plan_id, position),
    CONSTRAINT pk_revision_execution PRIMARY KEY (kb_id, number)
);
CREATE INDEX ix_revision_execution_execution ON revision_execution (kb_id, plan_id, position, number);
CREATE TABLE rule (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_rule_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_rule PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_rule_kb_id_key UNIQUE (kb_id, "key")
);
CREATE TABLE rule_node (
    kb_id BIGINT NOT NULL,
    rule_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    parent INTEGER,
    operator VARCHAR(32) NOT NULL,
    predicate_id BIGINT,
    function_id BIGINT,
    value TEXT,
    CONSTRAINT ck_rule_node_function_given CHECK ((operator = 'function') = (function_id IS NOT NULL)),
    CONSTRAINT ck_rule_node_one_root CHECK ((parent IS NULL) = (position = 0)),
    CONSTRAINT ck_rule_node_predicate_given CHECK ((operator = 'predicate') = (predicate_id IS NOT NULL)),
    CONSTRAINT ck_rule_node_preorder CHECK (parent < position),
    CONSTRAINT ck_rule_node_section CHECK (section = 'constraint'),
    CONSTRAINT fk_rule_node_kb_id_function_id FOREIGN KEY(kb_id, function_id) REFERENCES function (kb_id, id),
    CONSTRAINT fk_rule_node_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT fk_rule_node_parent FOREIGN KEY(kb_id, rule_id, since, section, parent) REFERENCES rule_node (kb_id, rule_id, since, section, position),
    CONSTRAINT fk_rule_node_version FOREIGN KEY(kb_id, rule_id, since) REFERENCES rule_version (kb_id, rule_id, since),
    CONSTRAINT pk_rule_node PRIMARY KEY (kb_id, rule_id, since, section, position)
);
CREATE INDEX ix_rule_node_function ON rule_node (kb_id, function_id);
CREATE INDEX ix_rule_node_predicate ON rule_node (kb_id, predicate_id);
CREATE TABLE rule_term (
    kb_id BIGINT NOT NULL,
    rule_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    term INTEGER NOT NULL,
    parameter INTEGER,
    object_id BIGINT,
    quantifier INTEGER,
    variable INTEGER,
    child INTEGER,
    CONSTRAINT ck_rule_term_bound CHECK ((quantifier IS NULL) = (variable IS NULL)),
    CONSTRAINT ck_rule_term_no_parameter CHECK (parameter IS NULL),
    CONSTRAINT ck_rule_term_one_of_four CHECK (CASE WHEN parameter IS NULL THEN 0 ELSE 1 END + CASE WHEN object_id IS NULL THEN 0 ELSE 1 END + CASE WHEN variable IS NULL THEN 0 ELSE 1 END + CASE WHEN child IS NULL THEN 0 ELSE 1 END = 1),
    CONSTRAINT fk_rule_term_child FOREIGN KEY(kb_id, rule_id, since, section, child) REFERENCES rule_node (kb_id, rule_id, since, section, position),
    CONSTRAINT fk_rule_term_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_rule_term_node FOREIGN KEY(kb_id, rule_id, since, section, position) REFERENCES rule_node (kb_id, rule_id, since, section, position),
    CONSTRAINT fk_rule_term_variable FOREIGN KEY(kb_id, rule_id, since, section, quantifier, variable) REFERENCES rule_variable (kb_id, rule_id, since, section, position, variable),
    CONSTRAINT pk_rule_term PRIMARY KEY (kb_id, rule_id, since, section, position, term)
);
CREATE INDEX ix_rule_term_object ON rule_term (kb_id, object_id);
CREATE TABLE rule_variable (
    kb_id BIGINT NOT NULL,
    rule_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    variable INTEGER NOT NULL,
    name VARCHAR(255) NOT NULL,
    CONSTRAINT fk_rule_variable_node FOREIGN KEY(kb_id, rule_id, since, section, position) REFERENCES rule_node (kb_id, rule_id, since, section, position),
    CONSTRAINT pk_rule_variable PRIMARY KEY (kb_id, rule_id, since, section, position, variable)
);
CREATE TABLE rule_variable_type (
    kb_id BIGINT NOT NULL,
    rule_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(24) NOT NULL,
    position INTEGER NOT NULL,
    variable INTEGER NOT NULL,
    alternative INTEGER NOT NULL,
    type_id BIGINT NOT NULL,
    CONSTRAINT fk_rule_variable_type_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_rule_variable_type_variable FOREIGN KEY(kb_id, rule_id, since, section, position, variable) REFERENCES rule_variable (kb_id, rule_id, since, section, position, variable),
    CONSTRAINT pk_rule_variable_type PRIMARY KEY (kb_id, rule_id, since, section, position, variable, alternative)
);
CREATE INDEX ix_rule_variable_type_type ON rule_variable_type (kb_id, type_id);
CREATE TABLE rule_version (
    kb_id BIGINT NOT NULL,
    rule_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    on_violation VARCHAR(16) NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT ck_rule_version_on_violation CHECK (on_violation IN ('report', 'refuse')),
    CONSTRAINT ck_rule_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_rule_version_kb_id_rule_id FOREIGN KEY(kb_id, rule_id) REFERENCES rule (kb_id, id),
    CONSTRAINT fk_rule_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_rule_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_rule_version PRIMARY KEY (kb_id, rule_id, since)
);
CREATE INDEX ix_rule_version_since ON rule_version (kb_id, since, rule_id);
CREATE INDEX ix_rule_version_until ON rule_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_rule_version_live ON rule_version (kb_id, rule_id) WHERE until IS NULL;
CREATE TABLE type (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_type_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_type PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_type_kb_id_key UNIQUE (kb_id, "key")
);
CREATE TABLE type_parent (
    kb_id BIGINT NOT NULL,
    type_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    position INTEGER NOT NULL,
    parent_id BIGINT NOT NULL,
    CONSTRAINT fk_type_parent_kb_id_parent_id FOREIGN KEY(kb_id, parent_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_type_parent_kb_id_type_id_since FOREIGN KEY(kb_id, type_id, since) REFERENCES type_version (kb_id, type_id, since),
    CONSTRAINT pk_type_parent PRIMARY KEY (kb_id, type_id, since, position)
);
CREATE INDEX ix_type_parent_parent ON type_parent (kb_id, parent_id);
CREATE TABLE type_version (
    kb_id BIGINT NOT NULL,
    type_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    parent_id BIGINT,
    text TEXT NOT NULL,
    CONSTRAINT ck_type_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_type_version_kb_id_parent_id FOREIGN KEY(kb_id, parent_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_type_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_type_version_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_type_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_type_version PRIMARY KEY (kb_id, type_id, since)
);
CREATE INDEX ix_type_version_since ON type_version (kb_id, since, type_id);
CREATE INDEX ix_type_version_until ON type_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_type_version_live ON type_version (kb_id, type_id) WHERE until IS NULL;
CREATE TABLE verification (
    kb_id BIGINT NOT NULL,
    revision BIGINT NOT NULL,
    hash TEXT NOT NULL,
    verified_at VARCHAR(27) NOT NULL,
    complete_at VARCHAR(27),
    CONSTRAINT fk_verification_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_verification PRIMARY KEY (kb_id)
);
