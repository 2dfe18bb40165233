CREATE TABLE action (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_action_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_action PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_action_kb_id_key UNIQUE (kb_id, key)
);
COMMENT ON COLUMN action.name IS 'in its first spelling';
COMMENT ON COLUMN action.key IS 'the name as compared: case folded';
CREATE TABLE action_expression (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(16) NOT NULL,
    "position" integer NOT NULL,
    parent integer,
    operator character varying(32) NOT NULL,
    predicate_id bigint,
    value text COLLATE "C",
    CONSTRAINT ck_action_expression_one_root CHECK (((parent IS NULL) = ("position" = 0))),
    CONSTRAINT ck_action_expression_predicate_given CHECK ((((operator)::text = 'predicate'::text) = (predicate_id IS NOT NULL))),
    CONSTRAINT ck_action_expression_preorder CHECK ((parent < "position")),
    CONSTRAINT ck_action_expression_section CHECK (((section)::text = ANY ((ARRAY['duration'::character varying, 'condition'::character varying, 'effect'::character varying])::text[]))),
    CONSTRAINT fk_action_expression_kb_id_action_id_since FOREIGN KEY (kb_id, action_id, since) REFERENCES action_version(kb_id, action_id, since),
    CONSTRAINT fk_action_expression_kb_id_action_id_since_section_parent FOREIGN KEY (kb_id, action_id, since, section, parent) REFERENCES action_expression(kb_id, action_id, since, section, "position"),
    CONSTRAINT fk_action_expression_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT pk_action_expression PRIMARY KEY (kb_id, action_id, since, section, "position")
);
CREATE INDEX ix_action_expression_predicate ON public.action_expression USING btree (kb_id, predicate_id);
COMMENT ON COLUMN action_expression.since IS 'asserted in this revision';
COMMENT ON COLUMN action_expression.section IS 'duration, condition or effect';
COMMENT ON COLUMN action_expression."position" IS 'from 0, in preorder';
COMMENT ON COLUMN action_expression.parent IS 'the position of the node above; NULL: the root';
COMMENT ON COLUMN action_expression.operator IS 'and, not, at start, over all, at end, =, predicate, variable, number';
COMMENT ON COLUMN action_expression.value IS 'a number as exact decimal text, or a variable''s name';
CREATE TABLE action_expression_term (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(16) NOT NULL,
    "position" integer NOT NULL,
    term integer NOT NULL,
    parameter integer,
    object_id bigint,
    CONSTRAINT ck_action_expression_term_parameter_or_object CHECK (((parameter IS NULL) <> (object_id IS NULL))),
    CONSTRAINT fk_action_expression_term_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_action_expression_term_node FOREIGN KEY (kb_id, action_id, since, section, "position") REFERENCES action_expression(kb_id, action_id, since, section, "position"),
    CONSTRAINT fk_action_expression_term_parameter FOREIGN KEY (kb_id, action_id, since, parameter) REFERENCES action_parameter(kb_id, action_id, since, "position"),
    CONSTRAINT pk_action_expression_term PRIMARY KEY (kb_id, action_id, since, section, "position", term)
);
CREATE INDEX ix_action_expression_term_object ON public.action_expression_term USING btree (kb_id, object_id);
COMMENT ON COLUMN action_expression_term.since IS 'asserted in this revision';
COMMENT ON COLUMN action_expression_term.term IS 'from 0';
COMMENT ON COLUMN action_expression_term.parameter IS 'the position of the action''s parameter';
COMMENT ON COLUMN action_expression_term.object_id IS 'the constant';
CREATE TABLE action_parameter (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    CONSTRAINT fk_action_parameter_kb_id_action_id_since FOREIGN KEY (kb_id, action_id, since) REFERENCES action_version(kb_id, action_id, since),
    CONSTRAINT pk_action_parameter PRIMARY KEY (kb_id, action_id, since, "position")
);
COMMENT ON COLUMN action_parameter.since IS 'asserted in this revision';
COMMENT ON COLUMN action_parameter."position" IS 'from 0';
COMMENT ON COLUMN action_parameter.name IS 'without its question mark';
CREATE TABLE action_parameter_type (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    alternative integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_action_parameter_type_kb_id_action_id_since_position FOREIGN KEY (kb_id, action_id, since, "position") REFERENCES action_parameter(kb_id, action_id, since, "position"),
    CONSTRAINT fk_action_parameter_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT pk_action_parameter_type PRIMARY KEY (kb_id, action_id, since, "position", alternative)
);
CREATE INDEX ix_action_parameter_type_type ON public.action_parameter_type USING btree (kb_id, type_id);
COMMENT ON COLUMN action_parameter_type.since IS 'asserted in this revision';
COMMENT ON COLUMN action_parameter_type.alternative IS 'from 0: several for either';
CREATE TABLE action_version (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    durative boolean NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_action_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_action_version_kb_id_action_id FOREIGN KEY (kb_id, action_id) REFERENCES action(kb_id, id),
    CONSTRAINT fk_action_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_action_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_action_version PRIMARY KEY (kb_id, action_id, since)
);
CREATE INDEX ix_action_version_since ON public.action_version USING btree (kb_id, since);
CREATE INDEX ix_action_version_until ON public.action_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_action_version_live ON public.action_version USING btree (kb_id, action_id) WHERE (until IS NULL);
COMMENT ON COLUMN action_version.since IS 'asserted in this revision';
COMMENT ON COLUMN action_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN action_version.text IS 'canonical PDDL';
CREATE TABLE head (
    kb_id bigint NOT NULL,
    revision bigint NOT NULL,
    definition_revision bigint NOT NULL,
    next_id bigint NOT NULL,
    hash text COLLATE "C",
    committed_at timestamp with time zone,
    CONSTRAINT fk_head_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_head PRIMARY KEY (kb_id)
);
COMMENT ON COLUMN head.revision IS 'the last revision; 0: none yet';
COMMENT ON COLUMN head.definition_revision IS 'the last revision that changed anything but propositions';
COMMENT ON COLUMN head.next_id IS 'the id that the next element gets';
COMMENT ON COLUMN head.hash IS 'of the last revision';
COMMENT ON COLUMN head.committed_at IS 'of the last revision';
CREATE TABLE kant_sql_version (
    version_num character varying(32) NOT NULL,
    CONSTRAINT kant_sql_version_pkc PRIMARY KEY (version_num)
);
CREATE TABLE knowledge_base (
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    CONSTRAINT pk_knowledge_base PRIMARY KEY (id),
    CONSTRAINT uq_knowledge_base_name UNIQUE (name)
);
CREATE TABLE object (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_object_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_object PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_object_kb_id_key UNIQUE (kb_id, key)
);
COMMENT ON COLUMN object.name IS 'in its first spelling';
COMMENT ON COLUMN object.key IS 'the name as compared: case folded';
CREATE TABLE object_version (
    kb_id bigint NOT NULL,
    object_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    type_id bigint NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_object_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_object_version_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_object_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_object_version_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_object_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_object_version PRIMARY KEY (kb_id, object_id, since)
);
CREATE INDEX ix_object_version_since ON public.object_version USING btree (kb_id, since);
CREATE INDEX ix_object_version_until ON public.object_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_object_version_live ON public.object_version USING btree (kb_id, object_id) WHERE (until IS NULL);
COMMENT ON COLUMN object_version.since IS 'asserted in this revision';
COMMENT ON COLUMN object_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN object_version.text IS 'canonical PDDL';
CREATE TABLE predicate (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_predicate_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_predicate PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_predicate_kb_id_key UNIQUE (kb_id, key)
);
COMMENT ON COLUMN predicate.name IS 'in its first spelling';
COMMENT ON COLUMN predicate.key IS 'the name as compared: case folded';
CREATE TABLE predicate_parameter (
    kb_id bigint NOT NULL,
    predicate_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    CONSTRAINT fk_predicate_parameter_kb_id_predicate_id_since FOREIGN KEY (kb_id, predicate_id, since) REFERENCES predicate_version(kb_id, predicate_id, since),
    CONSTRAINT pk_predicate_parameter PRIMARY KEY (kb_id, predicate_id, since, "position")
);
COMMENT ON COLUMN predicate_parameter.since IS 'asserted in this revision';
COMMENT ON COLUMN predicate_parameter."position" IS 'from 0';
COMMENT ON COLUMN predicate_parameter.name IS 'without its question mark';
CREATE TABLE predicate_parameter_type (
    kb_id bigint NOT NULL,
    predicate_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    alternative integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_predicate_parameter_type_kb_id_predicate_id_since_position FOREIGN KEY (kb_id, predicate_id, since, "position") REFERENCES predicate_parameter(kb_id, predicate_id, since, "position"),
    CONSTRAINT fk_predicate_parameter_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT pk_predicate_parameter_type PRIMARY KEY (kb_id, predicate_id, since, "position", alternative)
);
CREATE INDEX ix_predicate_parameter_type_type ON public.predicate_parameter_type USING btree (kb_id, type_id);
COMMENT ON COLUMN predicate_parameter_type.since IS 'asserted in this revision';
COMMENT ON COLUMN predicate_parameter_type.alternative IS 'from 0: several for either';
CREATE TABLE predicate_version (
    kb_id bigint NOT NULL,
    predicate_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_predicate_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_predicate_version_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT fk_predicate_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_predicate_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_predicate_version PRIMARY KEY (kb_id, predicate_id, since)
);
CREATE INDEX ix_predicate_version_since ON public.predicate_version USING btree (kb_id, since);
CREATE INDEX ix_predicate_version_until ON public.predicate_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_predicate_version_live ON public.predicate_version USING btree (kb_id, predicate_id) WHERE (until IS NULL);
COMMENT ON COLUMN predicate_version.since IS 'asserted in this revision';
COMMENT ON COLUMN predicate_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN predicate_version.text IS 'canonical PDDL';
CREATE TABLE proposition (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    predicate_id bigint NOT NULL,
    is_goal boolean NOT NULL,
    arguments text COLLATE "C" NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT fk_proposition_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT pk_proposition PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_proposition_atom UNIQUE (kb_id, is_goal, predicate_id, arguments)
);
COMMENT ON COLUMN proposition.arguments IS 'the ids of its objects in order, by spaces: the key that interns it';
COMMENT ON COLUMN proposition.text IS 'canonical PDDL';
CREATE TABLE proposition_argument (
    kb_id bigint NOT NULL,
    proposition_id bigint NOT NULL,
    "position" integer NOT NULL,
    object_id bigint NOT NULL,
    CONSTRAINT fk_proposition_argument_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_proposition_argument_kb_id_proposition_id FOREIGN KEY (kb_id, proposition_id) REFERENCES proposition(kb_id, id),
    CONSTRAINT pk_proposition_argument PRIMARY KEY (kb_id, proposition_id, "position")
);
CREATE INDEX ix_proposition_argument_object ON public.proposition_argument USING btree (kb_id, object_id, proposition_id);
COMMENT ON COLUMN proposition_argument."position" IS 'from 0';
CREATE TABLE proposition_version (
    kb_id bigint NOT NULL,
    proposition_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    predicate_id bigint NOT NULL,
    CONSTRAINT ck_proposition_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_proposition_version_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_proposition_id FOREIGN KEY (kb_id, proposition_id) REFERENCES proposition(kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_proposition_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_proposition_version PRIMARY KEY (kb_id, proposition_id, since)
);
CREATE INDEX ix_proposition_version_history ON public.proposition_version USING btree (kb_id, predicate_id, since, until, proposition_id);
CREATE INDEX ix_proposition_version_now ON public.proposition_version USING btree (kb_id, predicate_id, proposition_id, until) WHERE (until IS NULL);
CREATE INDEX ix_proposition_version_since ON public.proposition_version USING btree (kb_id, since);
CREATE INDEX ix_proposition_version_until ON public.proposition_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_proposition_version_live ON public.proposition_version USING btree (kb_id, proposition_id) WHERE (until IS NULL);
COMMENT ON COLUMN proposition_version.since IS 'asserted in this revision';
COMMENT ON COLUMN proposition_version.until IS 'retracted in this revision; NULL: holds now';
CREATE TABLE revision (
    kb_id bigint NOT NULL,
    number bigint NOT NULL,
    committed_at timestamp with time zone NOT NULL,
    actor text COLLATE "C",
    reason text COLLATE "C",
    source json,
    form integer NOT NULL,
    hash text COLLATE "C" NOT NULL,
    CONSTRAINT ck_revision_number_positive CHECK ((number > 0)),
    CONSTRAINT fk_revision_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_revision PRIMARY KEY (kb_id, number)
);
CREATE INDEX ix_revision_committed_at ON public.revision USING btree (kb_id, committed_at);
COMMENT ON COLUMN revision.number IS '1, 2, 3 ... without gaps';
COMMENT ON COLUMN revision.committed_at IS 'UTC, never going back';
COMMENT ON COLUMN revision.actor IS 'the component that wrote';
COMMENT ON COLUMN revision.source IS 'what the caller knows: sensor, plan step ...';
COMMENT ON COLUMN revision.form IS 'version of the form that was hashed';
COMMENT ON COLUMN revision.hash IS 'SHA-256, chained to the revision before';
CREATE TABLE type (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_type_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_type PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_type_kb_id_key UNIQUE (kb_id, key)
);
COMMENT ON COLUMN type.name IS 'in its first spelling';
COMMENT ON COLUMN type.key IS 'the name as compared: case folded';
CREATE TABLE type_version (
    kb_id bigint NOT NULL,
    type_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    parent_id bigint,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_type_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_type_version_kb_id_parent_id FOREIGN KEY (kb_id, parent_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_type_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_type_version_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_type_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_type_version PRIMARY KEY (kb_id, type_id, since)
);
CREATE INDEX ix_type_version_since ON public.type_version USING btree (kb_id, since);
CREATE INDEX ix_type_version_until ON public.type_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_type_version_live ON public.type_version USING btree (kb_id, type_id) WHERE (until IS NULL);
COMMENT ON COLUMN type_version.since IS 'asserted in this revision';
COMMENT ON COLUMN type_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN type_version.parent_id IS 'the type above it; NULL: right under the root';
COMMENT ON COLUMN type_version.text IS 'canonical PDDL';
