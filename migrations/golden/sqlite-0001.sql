CREATE TABLE action (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_action_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_action PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_action_kb_id_key UNIQUE (kb_id, "key")
);
CREATE TABLE action_expression (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(16) NOT NULL,
    position INTEGER NOT NULL,
    parent INTEGER,
    operator VARCHAR(32) NOT NULL,
    predicate_id BIGINT,
    value TEXT,
    CONSTRAINT ck_action_expression_one_root CHECK ((parent IS NULL) = (position = 0)),
    CONSTRAINT ck_action_expression_predicate_given CHECK ((operator = 'predicate') = (predicate_id IS NOT NULL)),
    CONSTRAINT ck_action_expression_preorder CHECK (parent < position),
    CONSTRAINT ck_action_expression_section CHECK (section IN ('duration', 'condition', 'effect')),
    CONSTRAINT fk_action_expression_kb_id_action_id_since FOREIGN KEY(kb_id, action_id, since) REFERENCES action_version (kb_id, action_id, since),
    CONSTRAINT fk_action_expression_kb_id_action_id_since_section_parent FOREIGN KEY(kb_id, action_id, since, section, parent) REFERENCES action_expression (kb_id, action_id, since, section, position),
    CONSTRAINT fk_action_expression_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT pk_action_expression PRIMARY KEY (kb_id, action_id, since, section, position)
);
CREATE INDEX ix_action_expression_predicate ON action_expression (kb_id, predicate_id);
CREATE TABLE action_expression_term (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    section VARCHAR(16) NOT NULL,
    position INTEGER NOT NULL,
    term INTEGER NOT NULL,
    parameter INTEGER,
    object_id BIGINT,
    CONSTRAINT ck_action_expression_term_parameter_or_object CHECK ((parameter IS NULL) <> (object_id IS NULL)),
    CONSTRAINT fk_action_expression_term_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_action_expression_term_node FOREIGN KEY(kb_id, action_id, since, section, position) REFERENCES action_expression (kb_id, action_id, since, section, position),
    CONSTRAINT fk_action_expression_term_parameter FOREIGN KEY(kb_id, action_id, since, parameter) REFERENCES action_parameter (kb_id, action_id, since, position),
    CONSTRAINT pk_action_expression_term PRIMARY KEY (kb_id, action_id, since, section, position, term)
);
CREATE INDEX ix_action_expression_term_object ON action_expression_term (kb_id, object_id);
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
CREATE TABLE action_version (
    kb_id BIGINT NOT NULL,
    action_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    durative BOOLEAN NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT ck_action_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_action_version_kb_id_action_id FOREIGN KEY(kb_id, action_id) REFERENCES action (kb_id, id),
    CONSTRAINT fk_action_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_action_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_action_version PRIMARY KEY (kb_id, action_id, since)
);
CREATE INDEX ix_action_version_since ON action_version (kb_id, since);
CREATE INDEX ix_action_version_until ON action_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_action_version_live ON action_version (kb_id, action_id) WHERE until IS NULL;
CREATE TABLE head (
    kb_id BIGINT NOT NULL,
    revision BIGINT NOT NULL,
    definition_revision BIGINT NOT NULL,
    next_id BIGINT NOT NULL,
    hash TEXT,
    committed_at VARCHAR(27),
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
CREATE TABLE object_version (
    kb_id BIGINT NOT NULL,
    object_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    type_id BIGINT NOT NULL,
    text TEXT NOT NULL,
    CONSTRAINT ck_object_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_object_version_kb_id_object_id FOREIGN KEY(kb_id, object_id) REFERENCES object (kb_id, id),
    CONSTRAINT fk_object_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_object_version_kb_id_type_id FOREIGN KEY(kb_id, type_id) REFERENCES type (kb_id, id),
    CONSTRAINT fk_object_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_object_version PRIMARY KEY (kb_id, object_id, since)
);
CREATE INDEX ix_object_version_since ON object_version (kb_id, since);
CREATE INDEX ix_object_version_until ON object_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_object_version_live ON object_version (kb_id, object_id) WHERE until IS NULL;
CREATE TABLE predicate (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_predicate_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_predicate PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_predicate_kb_id_key UNIQUE (kb_id, "key")
);
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
CREATE INDEX ix_predicate_version_since ON predicate_version (kb_id, since);
CREATE INDEX ix_predicate_version_until ON predicate_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_predicate_version_live ON predicate_version (kb_id, predicate_id) WHERE until IS NULL;
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
CREATE TABLE proposition_version (
    kb_id BIGINT NOT NULL,
    proposition_id BIGINT NOT NULL,
    since BIGINT NOT NULL,
    until BIGINT,
    predicate_id BIGINT NOT NULL,
    CONSTRAINT ck_proposition_version_since_before_until CHECK (since < until),
    CONSTRAINT fk_proposition_version_kb_id_predicate_id FOREIGN KEY(kb_id, predicate_id) REFERENCES predicate (kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_proposition_id FOREIGN KEY(kb_id, proposition_id) REFERENCES proposition (kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_since FOREIGN KEY(kb_id, since) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_proposition_version_kb_id_until FOREIGN KEY(kb_id, until) REFERENCES revision (kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_proposition_version PRIMARY KEY (kb_id, proposition_id, since)
);
CREATE INDEX ix_proposition_version_history ON proposition_version (kb_id, predicate_id, since, until, proposition_id);
CREATE INDEX ix_proposition_version_now ON proposition_version (kb_id, predicate_id, proposition_id, until) WHERE until IS NULL;
CREATE INDEX ix_proposition_version_since ON proposition_version (kb_id, since);
CREATE INDEX ix_proposition_version_until ON proposition_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_proposition_version_live ON proposition_version (kb_id, proposition_id) WHERE until IS NULL;
CREATE TABLE revision (
    kb_id BIGINT NOT NULL,
    number BIGINT NOT NULL,
    committed_at VARCHAR(27) NOT NULL,
    actor TEXT,
    reason TEXT,
    source TEXT,
    form INTEGER NOT NULL,
    hash TEXT NOT NULL,
    CONSTRAINT ck_revision_number_positive CHECK (number > 0),
    CONSTRAINT fk_revision_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_revision PRIMARY KEY (kb_id, number)
);
CREATE INDEX ix_revision_committed_at ON revision (kb_id, committed_at);
CREATE TABLE type (
    kb_id BIGINT NOT NULL,
    id BIGINT NOT NULL,
    name VARCHAR(255) NOT NULL,
    "key" TEXT NOT NULL,
    CONSTRAINT fk_type_kb_id FOREIGN KEY(kb_id) REFERENCES knowledge_base (id),
    CONSTRAINT pk_type PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_type_kb_id_key UNIQUE (kb_id, "key")
);
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
CREATE INDEX ix_type_version_since ON type_version (kb_id, since);
CREATE INDEX ix_type_version_until ON type_version (kb_id, until) WHERE until IS NOT NULL;
CREATE UNIQUE INDEX uq_type_version_live ON type_version (kb_id, type_id) WHERE until IS NULL;
