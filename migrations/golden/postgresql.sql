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
CREATE TABLE action_node (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    parent integer,
    operator character varying(32) NOT NULL,
    predicate_id bigint,
    function_id bigint,
    value text COLLATE "C",
    CONSTRAINT ck_action_node_function_given CHECK ((((operator)::text = 'function'::text) = (function_id IS NOT NULL))),
    CONSTRAINT ck_action_node_one_root CHECK (((parent IS NULL) = ("position" = 0))),
    CONSTRAINT ck_action_node_predicate_given CHECK ((((operator)::text = 'predicate'::text) = (predicate_id IS NOT NULL))),
    CONSTRAINT ck_action_node_preorder CHECK ((parent < "position")),
    CONSTRAINT ck_action_node_section CHECK (((section)::text = ANY ((ARRAY['duration'::character varying, 'condition'::character varying, 'effect'::character varying])::text[]))),
    CONSTRAINT fk_action_node_kb_id_function_id FOREIGN KEY (kb_id, function_id) REFERENCES function(kb_id, id),
    CONSTRAINT fk_action_node_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT fk_action_node_parent FOREIGN KEY (kb_id, action_id, since, section, parent) REFERENCES action_node(kb_id, action_id, since, section, "position"),
    CONSTRAINT fk_action_node_version FOREIGN KEY (kb_id, action_id, since) REFERENCES action_version(kb_id, action_id, since),
    CONSTRAINT pk_action_node PRIMARY KEY (kb_id, action_id, since, section, "position")
);
CREATE INDEX ix_action_node_function ON public.action_node USING btree (kb_id, function_id);
CREATE INDEX ix_action_node_predicate ON public.action_node USING btree (kb_id, predicate_id);
COMMENT ON COLUMN action_node.since IS 'asserted in this revision';
COMMENT ON COLUMN action_node.section IS 'the part of its owner';
COMMENT ON COLUMN action_node."position" IS 'from 0, in preorder';
COMMENT ON COLUMN action_node.parent IS 'the position of the node above; NULL: the root';
COMMENT ON COLUMN action_node.operator IS 'and, not, over all, increase, predicate, function, number ...';
COMMENT ON COLUMN action_node.value IS 'a number as exact decimal text, a variable''s or a preference''s name';
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
CREATE TABLE action_term (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    term integer NOT NULL,
    parameter integer,
    object_id bigint,
    quantifier integer,
    variable integer,
    child integer,
    CONSTRAINT ck_action_term_bound CHECK (((quantifier IS NULL) = (variable IS NULL))),
    CONSTRAINT ck_action_term_one_of_four CHECK (((((
CASE
    WHEN (parameter IS NULL) THEN 0
    ELSE 1
END +
CASE
    WHEN (object_id IS NULL) THEN 0
    ELSE 1
END) +
CASE
    WHEN (variable IS NULL) THEN 0
    ELSE 1
END) +
CASE
    WHEN (child IS NULL) THEN 0
    ELSE 1
END) = 1)),
    CONSTRAINT fk_action_term_child FOREIGN KEY (kb_id, action_id, since, section, child) REFERENCES action_node(kb_id, action_id, since, section, "position"),
    CONSTRAINT fk_action_term_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_action_term_node FOREIGN KEY (kb_id, action_id, since, section, "position") REFERENCES action_node(kb_id, action_id, since, section, "position"),
    CONSTRAINT fk_action_term_parameter FOREIGN KEY (kb_id, action_id, since, parameter) REFERENCES action_parameter(kb_id, action_id, since, "position"),
    CONSTRAINT fk_action_term_variable FOREIGN KEY (kb_id, action_id, since, section, quantifier, variable) REFERENCES action_variable(kb_id, action_id, since, section, "position", variable),
    CONSTRAINT pk_action_term PRIMARY KEY (kb_id, action_id, since, section, "position", term)
);
CREATE INDEX ix_action_term_object ON public.action_term USING btree (kb_id, object_id);
COMMENT ON COLUMN action_term.since IS 'asserted in this revision';
COMMENT ON COLUMN action_term.section IS 'the part of its owner';
COMMENT ON COLUMN action_term."position" IS 'from 0, in preorder';
COMMENT ON COLUMN action_term.term IS 'from 0';
COMMENT ON COLUMN action_term.parameter IS 'the position of the owner''s parameter';
COMMENT ON COLUMN action_term.object_id IS 'the constant';
COMMENT ON COLUMN action_term.quantifier IS 'the position of the node that binds the variable';
COMMENT ON COLUMN action_term.variable IS 'which of the quantifier''s variables it is';
COMMENT ON COLUMN action_term.child IS 'the position of the function node whose value it is';
CREATE TABLE action_variable (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    variable integer NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    CONSTRAINT fk_action_variable_node FOREIGN KEY (kb_id, action_id, since, section, "position") REFERENCES action_node(kb_id, action_id, since, section, "position"),
    CONSTRAINT pk_action_variable PRIMARY KEY (kb_id, action_id, since, section, "position", variable)
);
COMMENT ON COLUMN action_variable.since IS 'asserted in this revision';
COMMENT ON COLUMN action_variable.section IS 'the part of its owner';
COMMENT ON COLUMN action_variable."position" IS 'from 0, in preorder';
COMMENT ON COLUMN action_variable.variable IS 'from 0';
COMMENT ON COLUMN action_variable.name IS 'without its question mark';
CREATE TABLE action_variable_type (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    variable integer NOT NULL,
    alternative integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_action_variable_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_action_variable_type_variable FOREIGN KEY (kb_id, action_id, since, section, "position", variable) REFERENCES action_variable(kb_id, action_id, since, section, "position", variable),
    CONSTRAINT pk_action_variable_type PRIMARY KEY (kb_id, action_id, since, section, "position", variable, alternative)
);
CREATE INDEX ix_action_variable_type_type ON public.action_variable_type USING btree (kb_id, type_id);
COMMENT ON COLUMN action_variable_type.since IS 'asserted in this revision';
COMMENT ON COLUMN action_variable_type.section IS 'the part of its owner';
COMMENT ON COLUMN action_variable_type."position" IS 'from 0, in preorder';
COMMENT ON COLUMN action_variable_type.alternative IS 'from 0: several for either';
CREATE TABLE action_version (
    kb_id bigint NOT NULL,
    action_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    text text COLLATE "C" NOT NULL,
    kind character varying(16) DEFAULT 'action'::character varying NOT NULL,
    CONSTRAINT ck_action_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_action_version_kb_id_action_id FOREIGN KEY (kb_id, action_id) REFERENCES action(kb_id, id),
    CONSTRAINT fk_action_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_action_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_action_version PRIMARY KEY (kb_id, action_id, since)
);
CREATE INDEX ix_action_version_since ON public.action_version USING btree (kb_id, since, action_id);
CREATE INDEX ix_action_version_until ON public.action_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_action_version_live ON public.action_version USING btree (kb_id, action_id) WHERE (until IS NULL);
COMMENT ON COLUMN action_version.since IS 'asserted in this revision';
COMMENT ON COLUMN action_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN action_version.text IS 'canonical PDDL';
COMMENT ON COLUMN action_version.kind IS 'action, durative-action, process or event';
CREATE TABLE archive (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    since bigint NOT NULL,
    revision bigint NOT NULL,
    target text COLLATE "C" NOT NULL,
    versions bigint NOT NULL,
    rest text COLLATE "C" NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT fk_archive_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT fk_archive_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_archive_upto FOREIGN KEY (kb_id, revision) REFERENCES revision(kb_id, number),
    CONSTRAINT pk_archive PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_archive_revision ON public.archive USING btree (kb_id, revision);
CREATE INDEX ix_archive_since ON public.archive USING btree (kb_id, since);
COMMENT ON COLUMN archive.since IS 'recorded in this revision';
COMMENT ON COLUMN archive.revision IS 'the versions that ended up to this revision were moved';
COMMENT ON COLUMN archive.target IS 'where to: a URL without its password';
COMMENT ON COLUMN archive.versions IS 'how many were moved';
COMMENT ON COLUMN archive.rest IS 'SHA-256 of what this store keeps of the revisions up to there';
COMMENT ON COLUMN archive.text IS 'all of it in canonical form';
CREATE TABLE commitment (
    kb_id bigint NOT NULL,
    number bigint NOT NULL,
    "position" integer NOT NULL,
    sign character varying(1) NOT NULL,
    kind character varying(20) NOT NULL,
    owner_id bigint NOT NULL,
    place integer NOT NULL,
    salt bytea,
    commitment text COLLATE "C",
    erasure_id bigint,
    CONSTRAINT ck_commitment_commitment_of_erased CHECK (((commitment IS NULL) = (erasure_id IS NULL))),
    CONSTRAINT ck_commitment_kept_or_erased CHECK (((salt IS NULL) <> (erasure_id IS NULL))),
    CONSTRAINT fk_commitment_kb_id_number FOREIGN KEY (kb_id, number) REFERENCES revision(kb_id, number),
    CONSTRAINT pk_commitment PRIMARY KEY (kb_id, number, "position")
);
CREATE INDEX ix_commitment_erasure ON public.commitment USING btree (kb_id, erasure_id) WHERE (erasure_id IS NOT NULL);
COMMENT ON COLUMN commitment.number IS 'the revision';
COMMENT ON COLUMN commitment."position" IS 'among its changes, from 0; -1 source, -2 reason, -3 actor; -4: all, of form 1';
COMMENT ON COLUMN commitment.sign IS '+ asserted, - retracted; empty: no change';
COMMENT ON COLUMN commitment.kind IS 'of the change, or actor, reason, source, revision';
COMMENT ON COLUMN commitment.owner_id IS 'the element; of an execution, its plan; 0: no change';
COMMENT ON COLUMN commitment.place IS 'of an execution, its position; else 0';
COMMENT ON COLUMN commitment.salt IS 'of what is kept; NULL: erased';
COMMENT ON COLUMN commitment.commitment IS 'of what is erased; NULL: that of the text';
COMMENT ON COLUMN commitment.erasure_id IS 'what erased it; NULL: it is kept';
CREATE TABLE confirmation (
    kb_id bigint NOT NULL,
    proposition_id bigint NOT NULL,
    since bigint NOT NULL,
    CONSTRAINT fk_confirmation_kb_id_proposition_id FOREIGN KEY (kb_id, proposition_id) REFERENCES proposition(kb_id, id),
    CONSTRAINT fk_confirmation_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_confirmation PRIMARY KEY (kb_id, proposition_id, since)
);
CREATE INDEX ix_confirmation_since ON public.confirmation USING btree (kb_id, since);
COMMENT ON COLUMN confirmation.since IS 'recorded in this revision';
CREATE TABLE document (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT ck_document_domain_or_problem CHECK ((key = ANY (ARRAY['domain'::text, 'problem'::text]))),
    CONSTRAINT fk_document_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_document PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_document_kb_id_key UNIQUE (kb_id, key)
);
COMMENT ON COLUMN document.name IS 'in its first spelling';
COMMENT ON COLUMN document.key IS 'the name as compared: case folded';
CREATE TABLE document_item (
    kb_id bigint NOT NULL,
    document_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    name text COLLATE "C" NOT NULL,
    CONSTRAINT fk_document_item_kb_id_document_id_since FOREIGN KEY (kb_id, document_id, since) REFERENCES document_version(kb_id, document_id, since),
    CONSTRAINT pk_document_item PRIMARY KEY (kb_id, document_id, since, section, "position")
);
COMMENT ON COLUMN document_item.since IS 'asserted in this revision';
COMMENT ON COLUMN document_item.section IS 'requirement, type, goal ...';
COMMENT ON COLUMN document_item."position" IS 'from 0';
COMMENT ON COLUMN document_item.name IS 'the element''s name; for a goal that is a ground atom, its text';
CREATE TABLE document_version (
    kb_id bigint NOT NULL,
    document_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    title character varying(255) COLLATE "C" NOT NULL,
    domain character varying(255) COLLATE "C",
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_document_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_document_version_kb_id_document_id FOREIGN KEY (kb_id, document_id) REFERENCES document(kb_id, id),
    CONSTRAINT fk_document_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_document_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_document_version PRIMARY KEY (kb_id, document_id, since)
);
CREATE INDEX ix_document_version_since ON public.document_version USING btree (kb_id, since, document_id);
CREATE INDEX ix_document_version_until ON public.document_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_document_version_live ON public.document_version USING btree (kb_id, document_id) WHERE (until IS NULL);
COMMENT ON COLUMN document_version.since IS 'asserted in this revision';
COMMENT ON COLUMN document_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN document_version.title IS 'the name in its define form';
COMMENT ON COLUMN document_version.domain IS 'a problem''s domain';
COMMENT ON COLUMN document_version.text IS 'all of it on one line';
CREATE TABLE erasure (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    since bigint NOT NULL,
    revision bigint NOT NULL,
    kind character varying(16) NOT NULL,
    element_id bigint,
    pseudonym text COLLATE "C" NOT NULL,
    parts bigint NOT NULL,
    digest text COLLATE "C" NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT fk_erasure_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT fk_erasure_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_erasure_upto FOREIGN KEY (kb_id, revision) REFERENCES revision(kb_id, number),
    CONSTRAINT pk_erasure PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_erasure_revision ON public.erasure USING btree (kb_id, revision);
CREATE INDEX ix_erasure_since ON public.erasure USING btree (kb_id, since);
COMMENT ON COLUMN erasure.since IS 'recorded in this revision';
COMMENT ON COLUMN erasure.revision IS 'in revisions up to this one';
COMMENT ON COLUMN erasure.kind IS 'object, or actor, reason or source of revisions';
COMMENT ON COLUMN erasure.element_id IS 'the object; NULL: texts of revisions';
COMMENT ON COLUMN erasure.pseudonym IS 'what is there now';
COMMENT ON COLUMN erasure.parts IS 'how many texts were erased';
COMMENT ON COLUMN erasure.digest IS 'SHA-256 of their commitments, and of what took their places';
COMMENT ON COLUMN erasure.text IS 'all of it in canonical form';
CREATE TABLE execution (
    kb_id bigint NOT NULL,
    plan_id bigint NOT NULL,
    "position" integer NOT NULL,
    since bigint NOT NULL,
    start text COLLATE "C",
    duration text COLLATE "C",
    action_id bigint,
    name text COLLATE "C",
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_execution_action_or_name CHECK (((action_id IS NULL) <> (name IS NULL))),
    CONSTRAINT fk_execution_kb_id_action_id FOREIGN KEY (kb_id, action_id) REFERENCES action(kb_id, id),
    CONSTRAINT pk_execution PRIMARY KEY (kb_id, plan_id, "position")
);
CREATE INDEX ix_execution_action ON public.execution USING btree (kb_id, action_id);
CREATE INDEX ix_execution_name ON public.execution USING btree (kb_id, name) WHERE (name IS NOT NULL);
COMMENT ON COLUMN execution.plan_id IS '0: it is of no plan';
COMMENT ON COLUMN execution."position" IS 'of a step: from 0; of no plan: the id';
COMMENT ON COLUMN execution.since IS 'recorded in this revision, with its plan if it has one';
COMMENT ON COLUMN execution.start IS 'seconds from the plan''s beginning, as exact decimal text';
COMMENT ON COLUMN execution.duration IS 'seconds, as exact decimal text; NULL: an instant, or not known';
COMMENT ON COLUMN execution.action_id IS 'NULL: it is no action of the domain';
COMMENT ON COLUMN execution.name IS 'what it is called that is no action of the domain';
COMMENT ON COLUMN execution.text IS 'action and arguments, without times; what is no PDDL is quoted';
CREATE TABLE execution_argument (
    kb_id bigint NOT NULL,
    plan_id bigint NOT NULL,
    "position" integer NOT NULL,
    argument integer NOT NULL,
    object_id bigint,
    value text COLLATE "C",
    CONSTRAINT ck_execution_argument_object_or_value CHECK (((object_id IS NULL) <> (value IS NULL))),
    CONSTRAINT fk_execution_argument_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_execution_argument_kb_id_plan_id_position FOREIGN KEY (kb_id, plan_id, "position") REFERENCES execution(kb_id, plan_id, "position"),
    CONSTRAINT pk_execution_argument PRIMARY KEY (kb_id, plan_id, "position", argument)
);
CREATE INDEX ix_execution_argument_object ON public.execution_argument USING btree (kb_id, object_id);
COMMENT ON COLUMN execution_argument.argument IS 'from 0';
COMMENT ON COLUMN execution_argument.object_id IS 'NULL: it is no object of the knowledge base';
COMMENT ON COLUMN execution_argument.value IS 'what was said instead of an object';
CREATE TABLE execution_version (
    kb_id bigint NOT NULL,
    plan_id bigint NOT NULL,
    "position" integer NOT NULL,
    since bigint NOT NULL,
    until bigint,
    kind character varying(16) NOT NULL,
    outcome character varying(16) NOT NULL,
    code text COLLATE "C",
    message text COLLATE "C",
    started_at timestamp with time zone,
    ended_at timestamp with time zone,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_execution_version_kind CHECK (((kind)::text = ANY ((ARRAY['execution'::character varying, 'plan step'::character varying])::text[]))),
    CONSTRAINT ck_execution_version_outcome CHECK (((outcome)::text = ANY ((ARRAY['running'::character varying, 'succeeded'::character varying, 'failed'::character varying, 'aborted'::character varying, 'refused'::character varying])::text[]))),
    CONSTRAINT ck_execution_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_execution_version_kb_id_plan_id_position FOREIGN KEY (kb_id, plan_id, "position") REFERENCES execution(kb_id, plan_id, "position"),
    CONSTRAINT fk_execution_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_execution_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_execution_version PRIMARY KEY (kb_id, plan_id, "position", since)
);
CREATE INDEX ix_execution_version_running ON public.execution_version USING btree (kb_id, outcome, plan_id, "position", until) WHERE ((until IS NULL) AND ((outcome)::text = 'running'::text));
CREATE INDEX ix_execution_version_since ON public.execution_version USING btree (kb_id, since);
CREATE INDEX ix_execution_version_until ON public.execution_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
COMMENT ON COLUMN execution_version.since IS 'asserted in this revision';
COMMENT ON COLUMN execution_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN execution_version.kind IS 'execution; plan step: written before version 0008';
COMMENT ON COLUMN execution_version.outcome IS 'running, succeeded, failed, aborted or refused';
COMMENT ON COLUMN execution_version.code IS 'of a failure';
COMMENT ON COLUMN execution_version.message IS 'what is said of a failure, or did not hold';
COMMENT ON COLUMN execution_version.started_at IS 'UTC; NULL: when the revision was committed';
COMMENT ON COLUMN execution_version.ended_at IS 'UTC; NULL: when the revision was committed';
COMMENT ON COLUMN execution_version.text IS 'which execution it is, and its outcome';
CREATE TABLE formula (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_formula_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_formula PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_formula_kb_id_key UNIQUE (kb_id, key)
);
COMMENT ON COLUMN formula.name IS 'in its first spelling';
COMMENT ON COLUMN formula.key IS 'the name as compared: case folded';
CREATE TABLE formula_node (
    kb_id bigint NOT NULL,
    formula_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    parent integer,
    operator character varying(32) NOT NULL,
    predicate_id bigint,
    function_id bigint,
    value text COLLATE "C",
    CONSTRAINT ck_formula_node_function_given CHECK ((((operator)::text = 'function'::text) = (function_id IS NOT NULL))),
    CONSTRAINT ck_formula_node_one_root CHECK (((parent IS NULL) = ("position" = 0))),
    CONSTRAINT ck_formula_node_predicate_given CHECK ((((operator)::text = 'predicate'::text) = (predicate_id IS NOT NULL))),
    CONSTRAINT ck_formula_node_preorder CHECK ((parent < "position")),
    CONSTRAINT fk_formula_node_kb_id_function_id FOREIGN KEY (kb_id, function_id) REFERENCES function(kb_id, id),
    CONSTRAINT fk_formula_node_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT fk_formula_node_parent FOREIGN KEY (kb_id, formula_id, since, section, parent) REFERENCES formula_node(kb_id, formula_id, since, section, "position"),
    CONSTRAINT fk_formula_node_version FOREIGN KEY (kb_id, formula_id, since) REFERENCES formula_version(kb_id, formula_id, since),
    CONSTRAINT pk_formula_node PRIMARY KEY (kb_id, formula_id, since, section, "position")
);
CREATE INDEX ix_formula_node_function ON public.formula_node USING btree (kb_id, function_id);
CREATE INDEX ix_formula_node_predicate ON public.formula_node USING btree (kb_id, predicate_id);
COMMENT ON COLUMN formula_node.since IS 'asserted in this revision';
COMMENT ON COLUMN formula_node.section IS 'the part of its owner';
COMMENT ON COLUMN formula_node."position" IS 'from 0, in preorder';
COMMENT ON COLUMN formula_node.parent IS 'the position of the node above; NULL: the root';
COMMENT ON COLUMN formula_node.operator IS 'and, not, over all, increase, predicate, function, number ...';
COMMENT ON COLUMN formula_node.value IS 'a number as exact decimal text, a variable''s or a preference''s name';
CREATE TABLE formula_term (
    kb_id bigint NOT NULL,
    formula_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    term integer NOT NULL,
    parameter integer,
    object_id bigint,
    quantifier integer,
    variable integer,
    child integer,
    CONSTRAINT ck_formula_term_bound CHECK (((quantifier IS NULL) = (variable IS NULL))),
    CONSTRAINT ck_formula_term_no_parameter CHECK ((parameter IS NULL)),
    CONSTRAINT ck_formula_term_one_of_four CHECK (((((
CASE
    WHEN (parameter IS NULL) THEN 0
    ELSE 1
END +
CASE
    WHEN (object_id IS NULL) THEN 0
    ELSE 1
END) +
CASE
    WHEN (variable IS NULL) THEN 0
    ELSE 1
END) +
CASE
    WHEN (child IS NULL) THEN 0
    ELSE 1
END) = 1)),
    CONSTRAINT fk_formula_term_child FOREIGN KEY (kb_id, formula_id, since, section, child) REFERENCES formula_node(kb_id, formula_id, since, section, "position"),
    CONSTRAINT fk_formula_term_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_formula_term_node FOREIGN KEY (kb_id, formula_id, since, section, "position") REFERENCES formula_node(kb_id, formula_id, since, section, "position"),
    CONSTRAINT fk_formula_term_variable FOREIGN KEY (kb_id, formula_id, since, section, quantifier, variable) REFERENCES formula_variable(kb_id, formula_id, since, section, "position", variable),
    CONSTRAINT pk_formula_term PRIMARY KEY (kb_id, formula_id, since, section, "position", term)
);
CREATE INDEX ix_formula_term_object ON public.formula_term USING btree (kb_id, object_id);
COMMENT ON COLUMN formula_term.since IS 'asserted in this revision';
COMMENT ON COLUMN formula_term.section IS 'the part of its owner';
COMMENT ON COLUMN formula_term."position" IS 'from 0, in preorder';
COMMENT ON COLUMN formula_term.term IS 'from 0';
COMMENT ON COLUMN formula_term.parameter IS 'the position of the owner''s parameter';
COMMENT ON COLUMN formula_term.object_id IS 'the constant';
COMMENT ON COLUMN formula_term.quantifier IS 'the position of the node that binds the variable';
COMMENT ON COLUMN formula_term.variable IS 'which of the quantifier''s variables it is';
COMMENT ON COLUMN formula_term.child IS 'the position of the function node whose value it is';
CREATE TABLE formula_variable (
    kb_id bigint NOT NULL,
    formula_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    variable integer NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    CONSTRAINT fk_formula_variable_node FOREIGN KEY (kb_id, formula_id, since, section, "position") REFERENCES formula_node(kb_id, formula_id, since, section, "position"),
    CONSTRAINT pk_formula_variable PRIMARY KEY (kb_id, formula_id, since, section, "position", variable)
);
COMMENT ON COLUMN formula_variable.since IS 'asserted in this revision';
COMMENT ON COLUMN formula_variable.section IS 'the part of its owner';
COMMENT ON COLUMN formula_variable."position" IS 'from 0, in preorder';
COMMENT ON COLUMN formula_variable.variable IS 'from 0';
COMMENT ON COLUMN formula_variable.name IS 'without its question mark';
CREATE TABLE formula_variable_type (
    kb_id bigint NOT NULL,
    formula_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    variable integer NOT NULL,
    alternative integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_formula_variable_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_formula_variable_type_variable FOREIGN KEY (kb_id, formula_id, since, section, "position", variable) REFERENCES formula_variable(kb_id, formula_id, since, section, "position", variable),
    CONSTRAINT pk_formula_variable_type PRIMARY KEY (kb_id, formula_id, since, section, "position", variable, alternative)
);
CREATE INDEX ix_formula_variable_type_type ON public.formula_variable_type USING btree (kb_id, type_id);
COMMENT ON COLUMN formula_variable_type.since IS 'asserted in this revision';
COMMENT ON COLUMN formula_variable_type.section IS 'the part of its owner';
COMMENT ON COLUMN formula_variable_type."position" IS 'from 0, in preorder';
COMMENT ON COLUMN formula_variable_type.alternative IS 'from 0: several for either';
CREATE TABLE formula_version (
    kb_id bigint NOT NULL,
    formula_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    section character varying(24) NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_formula_version_section CHECK (((section)::text = ANY ((ARRAY['derived'::character varying, 'domain constraint'::character varying, 'initial'::character varying, 'timed'::character varying, 'goal'::character varying, 'constraint'::character varying, 'metric'::character varying])::text[]))),
    CONSTRAINT ck_formula_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_formula_version_kb_id_formula_id FOREIGN KEY (kb_id, formula_id) REFERENCES formula(kb_id, id),
    CONSTRAINT fk_formula_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_formula_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_formula_version PRIMARY KEY (kb_id, formula_id, since)
);
CREATE INDEX ix_formula_version_since ON public.formula_version USING btree (kb_id, since, formula_id);
CREATE INDEX ix_formula_version_until ON public.formula_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_formula_version_live ON public.formula_version USING btree (kb_id, formula_id) WHERE (until IS NULL);
COMMENT ON COLUMN formula_version.since IS 'asserted in this revision';
COMMENT ON COLUMN formula_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN formula_version.section IS 'the part of the domain or the problem that it stands in';
COMMENT ON COLUMN formula_version.text IS 'canonical PDDL';
CREATE TABLE function (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_function_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_function PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_function_kb_id_key UNIQUE (kb_id, key)
);
CREATE INDEX ix_function_name ON public.function USING hash (name);
COMMENT ON COLUMN function.name IS 'in its first spelling';
COMMENT ON COLUMN function.key IS 'the name as compared: case folded';
CREATE TABLE function_parameter (
    kb_id bigint NOT NULL,
    function_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    CONSTRAINT fk_function_parameter_kb_id_function_id_since FOREIGN KEY (kb_id, function_id, since) REFERENCES function_version(kb_id, function_id, since),
    CONSTRAINT pk_function_parameter PRIMARY KEY (kb_id, function_id, since, "position")
);
COMMENT ON COLUMN function_parameter.since IS 'asserted in this revision';
COMMENT ON COLUMN function_parameter."position" IS 'from 0';
COMMENT ON COLUMN function_parameter.name IS 'without its question mark';
CREATE TABLE function_parameter_type (
    kb_id bigint NOT NULL,
    function_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    alternative integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_function_parameter_type_kb_id_function_id_since_position FOREIGN KEY (kb_id, function_id, since, "position") REFERENCES function_parameter(kb_id, function_id, since, "position"),
    CONSTRAINT fk_function_parameter_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT pk_function_parameter_type PRIMARY KEY (kb_id, function_id, since, "position", alternative)
);
CREATE INDEX ix_function_parameter_type_type ON public.function_parameter_type USING btree (kb_id, type_id);
COMMENT ON COLUMN function_parameter_type.since IS 'asserted in this revision';
COMMENT ON COLUMN function_parameter_type.alternative IS 'from 0: several for either';
CREATE TABLE function_type (
    kb_id bigint NOT NULL,
    function_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_function_type_kb_id_function_id_since FOREIGN KEY (kb_id, function_id, since) REFERENCES function_version(kb_id, function_id, since),
    CONSTRAINT fk_function_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT pk_function_type PRIMARY KEY (kb_id, function_id, since, "position")
);
CREATE INDEX ix_function_type_type ON public.function_type USING btree (kb_id, type_id);
COMMENT ON COLUMN function_type.since IS 'asserted in this revision';
COMMENT ON COLUMN function_type."position" IS 'from 0';
CREATE TABLE function_value (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    function_id bigint NOT NULL,
    arguments text COLLATE "C" NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT fk_function_value_kb_id_function_id FOREIGN KEY (kb_id, function_id) REFERENCES function(kb_id, id),
    CONSTRAINT pk_function_value PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_function_value_fluent UNIQUE (kb_id, function_id, arguments)
);
CREATE INDEX ix_function_value_text ON public.function_value USING hash (text);
COMMENT ON COLUMN function_value.arguments IS 'the ids of its objects in order, by spaces: the key that interns it';
COMMENT ON COLUMN function_value.text IS 'canonical PDDL, without the value';
CREATE TABLE function_value_argument (
    kb_id bigint NOT NULL,
    function_value_id bigint NOT NULL,
    "position" integer NOT NULL,
    object_id bigint NOT NULL,
    CONSTRAINT fk_function_value_argument_kb_id_function_value_id FOREIGN KEY (kb_id, function_value_id) REFERENCES function_value(kb_id, id),
    CONSTRAINT fk_function_value_argument_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT pk_function_value_argument PRIMARY KEY (kb_id, function_value_id, "position")
);
CREATE INDEX ix_function_value_argument_object ON public.function_value_argument USING btree (kb_id, object_id, function_value_id);
COMMENT ON COLUMN function_value_argument."position" IS 'from 0';
CREATE TABLE function_value_saying (
    kb_id bigint NOT NULL,
    function_value_id bigint NOT NULL,
    since bigint NOT NULL,
    valid_from timestamp with time zone NOT NULL,
    valid_until timestamp with time zone NOT NULL,
    function_id bigint NOT NULL,
    value text COLLATE "C",
    number double precision,
    object_id bigint,
    fork bigint NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_function_value_saying_number_of_value CHECK (((value IS NULL) = (number IS NULL))),
    CONSTRAINT ck_function_value_saying_period CHECK ((valid_from < valid_until)),
    CONSTRAINT ck_function_value_saying_value_or_object CHECK (((value IS NULL) OR (object_id IS NULL))),
    CONSTRAINT fk_function_value_saying_kb_id_function_value_id FOREIGN KEY (kb_id, function_value_id) REFERENCES function_value(kb_id, id),
    CONSTRAINT fk_function_value_saying_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_function_value_saying_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_function_value_saying PRIMARY KEY (kb_id, function_value_id, since)
);
CREATE INDEX ix_function_value_saying_object ON public.function_value_saying USING btree (kb_id, object_id) WHERE (object_id IS NOT NULL);
CREATE INDEX ix_function_value_saying_since ON public.function_value_saying USING btree (kb_id, since);
CREATE INDEX ix_function_value_saying_valid ON public.function_value_saying USING btree (kb_id, function_id, fork, valid_from);
COMMENT ON COLUMN function_value_saying.since IS 'said in this revision';
COMMENT ON COLUMN function_value_saying.valid_from IS 'UTC, where the period begins';
COMMENT ON COLUMN function_value_saying.valid_until IS 'UTC, where it is over';
COMMENT ON COLUMN function_value_saying.value IS 'the number, as exact decimal text';
COMMENT ON COLUMN function_value_saying.number IS 'the number, as near as a double comes';
COMMENT ON COLUMN function_value_saying.object_id IS 'the object that it was';
COMMENT ON COLUMN function_value_saying.fork IS 'of its seconds since the year 1, as of a version';
COMMENT ON COLUMN function_value_saying.text IS 'canonical PDDL, with the period';
CREATE TABLE function_value_version (
    kb_id bigint NOT NULL,
    function_value_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    function_id bigint NOT NULL,
    value text COLLATE "C",
    number double precision,
    object_id bigint,
    text text COLLATE "C" NOT NULL,
    fork bigint DEFAULT 0 NOT NULL,
    CONSTRAINT ck_function_value_version_number_of_value CHECK (((value IS NULL) = (number IS NULL))),
    CONSTRAINT ck_function_value_version_since_before_until CHECK ((since < until)),
    CONSTRAINT ck_function_value_version_value_or_object CHECK (((value IS NULL) <> (object_id IS NULL))),
    CONSTRAINT fk_function_value_version_kb_id_function_id FOREIGN KEY (kb_id, function_id) REFERENCES function(kb_id, id),
    CONSTRAINT fk_function_value_version_kb_id_function_value_id FOREIGN KEY (kb_id, function_value_id) REFERENCES function_value(kb_id, id),
    CONSTRAINT fk_function_value_version_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_function_value_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_function_value_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_function_value_version PRIMARY KEY (kb_id, function_value_id, since)
);
CREATE INDEX ix_function_value_version_history ON public.function_value_version USING btree (kb_id, function_id, fork, since, until, function_value_id);
CREATE INDEX ix_function_value_version_now ON public.function_value_version USING btree (kb_id, function_id, function_value_id, until) WHERE (until IS NULL);
CREATE INDEX ix_function_value_version_object ON public.function_value_version USING btree (kb_id, object_id) WHERE (object_id IS NOT NULL);
CREATE INDEX ix_function_value_version_since ON public.function_value_version USING btree (kb_id, since);
CREATE INDEX ix_function_value_version_until ON public.function_value_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_function_value_version_live ON public.function_value_version USING btree (kb_id, function_value_id) WHERE (until IS NULL);
COMMENT ON COLUMN function_value_version.since IS 'asserted in this revision';
COMMENT ON COLUMN function_value_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN function_value_version.value IS 'the number, as exact decimal text';
COMMENT ON COLUMN function_value_version.number IS 'the number, as near as a double comes';
COMMENT ON COLUMN function_value_version.object_id IS 'the object that it is';
COMMENT ON COLUMN function_value_version.text IS 'canonical PDDL, with the value';
COMMENT ON COLUMN function_value_version.fork IS 'the revision from since to before until that the highest power of two divides; 0: holds now';
CREATE TABLE function_version (
    kb_id bigint NOT NULL,
    function_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_function_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_function_version_kb_id_function_id FOREIGN KEY (kb_id, function_id) REFERENCES function(kb_id, id),
    CONSTRAINT fk_function_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_function_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_function_version PRIMARY KEY (kb_id, function_id, since)
);
CREATE INDEX ix_function_version_since ON public.function_version USING btree (kb_id, since, function_id);
CREATE INDEX ix_function_version_until ON public.function_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_function_version_live ON public.function_version USING btree (kb_id, function_id) WHERE (until IS NULL);
COMMENT ON COLUMN function_version.since IS 'asserted in this revision';
COMMENT ON COLUMN function_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN function_version.text IS 'canonical PDDL';
CREATE TABLE head (
    kb_id bigint NOT NULL,
    revision bigint NOT NULL,
    definition_revision bigint NOT NULL,
    next_id bigint NOT NULL,
    hash text COLLATE "C",
    committed_at timestamp with time zone,
    archived_revision bigint DEFAULT 0 NOT NULL,
    origin text COLLATE "C",
    origin_revision bigint,
    origin_committed_at timestamp with time zone,
    heard_at timestamp with time zone,
    CONSTRAINT fk_head_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_head PRIMARY KEY (kb_id)
);
COMMENT ON COLUMN head.revision IS 'the last revision; 0: none yet';
COMMENT ON COLUMN head.definition_revision IS 'the last revision that changed anything but propositions';
COMMENT ON COLUMN head.next_id IS 'the id that the next element gets';
COMMENT ON COLUMN head.hash IS 'of the last revision';
COMMENT ON COLUMN head.committed_at IS 'of the last revision';
COMMENT ON COLUMN head.archived_revision IS 'what ended up to this revision is in an archive; 0: nothing is';
COMMENT ON COLUMN head.origin IS 'the store that it is replicated from: a URL without its password; NULL: written here';
COMMENT ON COLUMN head.origin_revision IS 'the origin''s last revision, as last heard of';
COMMENT ON COLUMN head.origin_committed_at IS 'UTC, of the origin''s last revision';
COMMENT ON COLUMN head.heard_at IS 'UTC, when the origin was last heard of';
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
CREATE INDEX ix_object_name ON public.object USING hash (name);
COMMENT ON COLUMN object.name IS 'in its first spelling';
COMMENT ON COLUMN object.key IS 'the name as compared: case folded';
CREATE TABLE object_type (
    kb_id bigint NOT NULL,
    object_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_object_type_kb_id_object_id_since FOREIGN KEY (kb_id, object_id, since) REFERENCES object_version(kb_id, object_id, since),
    CONSTRAINT fk_object_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT pk_object_type PRIMARY KEY (kb_id, object_id, since, "position")
);
CREATE INDEX ix_object_type_type ON public.object_type USING btree (kb_id, type_id);
COMMENT ON COLUMN object_type.since IS 'asserted in this revision';
COMMENT ON COLUMN object_type."position" IS 'from 1: the first is in the version';
CREATE TABLE object_version (
    kb_id bigint NOT NULL,
    object_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    type_id bigint NOT NULL,
    text text COLLATE "C" NOT NULL,
    is_constant boolean DEFAULT false NOT NULL,
    CONSTRAINT ck_object_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_object_version_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_object_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_object_version_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_object_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_object_version PRIMARY KEY (kb_id, object_id, since)
);
CREATE INDEX ix_object_version_since ON public.object_version USING btree (kb_id, since, object_id);
CREATE INDEX ix_object_version_until ON public.object_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_object_version_live ON public.object_version USING btree (kb_id, object_id) WHERE (until IS NULL);
COMMENT ON COLUMN object_version.since IS 'asserted in this revision';
COMMENT ON COLUMN object_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN object_version.text IS 'canonical PDDL';
COMMENT ON COLUMN object_version.is_constant IS 'declared in the domain, not in the problem';
CREATE TABLE plan (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    since bigint NOT NULL,
    revision bigint NOT NULL,
    problem_hash text COLLATE "C" NOT NULL,
    planner text COLLATE "C",
    planner_version text COLLATE "C",
    objective text COLLATE "C",
    value text COLLATE "C",
    status text COLLATE "C",
    domain_pddl text COLLATE "C",
    problem_pddl text COLLATE "C",
    text text COLLATE "C" NOT NULL,
    CONSTRAINT fk_plan_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT fk_plan_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_plan_problem FOREIGN KEY (kb_id, revision) REFERENCES revision(kb_id, number),
    CONSTRAINT pk_plan PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_plan_revision ON public.plan USING btree (kb_id, revision);
CREATE INDEX ix_plan_since ON public.plan USING btree (kb_id, since);
COMMENT ON COLUMN plan.since IS 'recorded in this revision';
COMMENT ON COLUMN plan.revision IS 'the state that it was planned from';
COMMENT ON COLUMN plan.problem_hash IS 'SHA-256 of the domain and then the problem that the planner was given';
COMMENT ON COLUMN plan.objective IS 'what the plan is to make small or large';
COMMENT ON COLUMN plan.value IS 'what the objective comes to, as exact decimal text';
COMMENT ON COLUMN plan.status IS 'what the planner says of it';
COMMENT ON COLUMN plan.domain_pddl IS 'what the planner was given, if it is not what the store writes';
COMMENT ON COLUMN plan.problem_pddl IS 'what the planner was given, if it is not what the store writes';
COMMENT ON COLUMN plan.text IS 'all of it in canonical form';
CREATE TABLE predicate (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_predicate_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_predicate PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_predicate_kb_id_key UNIQUE (kb_id, key)
);
CREATE INDEX ix_predicate_name ON public.predicate USING hash (name);
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
CREATE INDEX ix_predicate_version_since ON public.predicate_version USING btree (kb_id, since, predicate_id);
CREATE INDEX ix_predicate_version_until ON public.predicate_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_predicate_version_live ON public.predicate_version USING btree (kb_id, predicate_id) WHERE (until IS NULL);
COMMENT ON COLUMN predicate_version.since IS 'asserted in this revision';
COMMENT ON COLUMN predicate_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN predicate_version.text IS 'canonical PDDL';
CREATE TABLE promotion (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    since bigint NOT NULL,
    revision bigint NOT NULL,
    origin text COLLATE "C" NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT fk_promotion_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT fk_promotion_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_promotion_last FOREIGN KEY (kb_id, revision) REFERENCES revision(kb_id, number),
    CONSTRAINT pk_promotion PRIMARY KEY (kb_id, id)
);
CREATE INDEX ix_promotion_revision ON public.promotion USING btree (kb_id, revision);
CREATE INDEX ix_promotion_since ON public.promotion USING btree (kb_id, since);
COMMENT ON COLUMN promotion.since IS 'recorded in this revision';
COMMENT ON COLUMN promotion.revision IS 'the last one that was replicated';
COMMENT ON COLUMN promotion.origin IS 'where it was replicated from: a URL without its password';
COMMENT ON COLUMN promotion.text IS 'all of it in canonical form';
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
CREATE INDEX ix_proposition_text ON public.proposition USING hash (text);
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
CREATE TABLE proposition_saying (
    kb_id bigint NOT NULL,
    proposition_id bigint NOT NULL,
    since bigint NOT NULL,
    valid_from timestamp with time zone NOT NULL,
    valid_until timestamp with time zone NOT NULL,
    predicate_id bigint NOT NULL,
    holds boolean NOT NULL,
    first_object_id bigint,
    second_object_id bigint,
    fork bigint NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_proposition_saying_period CHECK ((valid_from < valid_until)),
    CONSTRAINT fk_proposition_saying_kb_id_proposition_id FOREIGN KEY (kb_id, proposition_id) REFERENCES proposition(kb_id, id),
    CONSTRAINT fk_proposition_saying_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_proposition_saying PRIMARY KEY (kb_id, proposition_id, since)
);
CREATE INDEX ix_proposition_saying_first ON public.proposition_saying USING btree (kb_id, predicate_id, first_object_id, fork, valid_from) WHERE (first_object_id IS NOT NULL);
CREATE INDEX ix_proposition_saying_second ON public.proposition_saying USING btree (kb_id, predicate_id, second_object_id, fork, valid_from) WHERE (second_object_id IS NOT NULL);
CREATE INDEX ix_proposition_saying_since ON public.proposition_saying USING btree (kb_id, since);
CREATE INDEX ix_proposition_saying_valid ON public.proposition_saying USING btree (kb_id, predicate_id, fork, valid_from);
COMMENT ON COLUMN proposition_saying.since IS 'said in this revision';
COMMENT ON COLUMN proposition_saying.valid_from IS 'UTC, where the period begins';
COMMENT ON COLUMN proposition_saying.valid_until IS 'UTC, where it is over';
COMMENT ON COLUMN proposition_saying.holds IS 'whether it held';
COMMENT ON COLUMN proposition_saying.first_object_id IS 'its first argument; NULL: it has none';
COMMENT ON COLUMN proposition_saying.second_object_id IS 'its second argument; NULL: it has fewer';
COMMENT ON COLUMN proposition_saying.fork IS 'of its seconds since the year 1, as of a version';
COMMENT ON COLUMN proposition_saying.text IS 'canonical PDDL, with the period';
CREATE TABLE proposition_version (
    kb_id bigint NOT NULL,
    proposition_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    predicate_id bigint NOT NULL,
    is_goal boolean DEFAULT false NOT NULL,
    fork bigint DEFAULT 0 NOT NULL,
    first_object_id bigint,
    second_object_id bigint,
    CONSTRAINT ck_proposition_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_proposition_version_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_proposition_id FOREIGN KEY (kb_id, proposition_id) REFERENCES proposition(kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_proposition_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_proposition_version PRIMARY KEY (kb_id, proposition_id, since)
);
CREATE INDEX ix_proposition_version_goal ON public.proposition_version USING btree (kb_id, until, since, proposition_id, is_goal) WHERE is_goal;
CREATE INDEX ix_proposition_version_goal_history ON public.proposition_version USING btree (kb_id, fork, since, until, proposition_id) WHERE is_goal;
CREATE INDEX ix_proposition_version_goal_since ON public.proposition_version USING btree (kb_id, since) WHERE is_goal;
CREATE INDEX ix_proposition_version_history ON public.proposition_version USING btree (kb_id, predicate_id, fork, first_object_id, since, until, proposition_id);
CREATE INDEX ix_proposition_version_history_second ON public.proposition_version USING btree (kb_id, predicate_id, fork, second_object_id, since, until, proposition_id) WHERE (second_object_id IS NOT NULL);
CREATE INDEX ix_proposition_version_now ON public.proposition_version USING btree (kb_id, predicate_id, is_goal, first_object_id, second_object_id, proposition_id, until) WHERE (until IS NULL);
CREATE INDEX ix_proposition_version_second ON public.proposition_version USING btree (kb_id, predicate_id, is_goal, second_object_id, first_object_id, proposition_id, until) WHERE ((until IS NULL) AND (second_object_id IS NOT NULL));
CREATE INDEX ix_proposition_version_since ON public.proposition_version USING btree (kb_id, since);
CREATE INDEX ix_proposition_version_until ON public.proposition_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_proposition_version_live ON public.proposition_version USING btree (proposition_id, kb_id) WHERE (until IS NULL);
COMMENT ON COLUMN proposition_version.since IS 'asserted in this revision';
COMMENT ON COLUMN proposition_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN proposition_version.fork IS 'the revision from since to before until that the highest power of two divides; 0: holds now';
COMMENT ON COLUMN proposition_version.first_object_id IS 'its first argument; NULL: it has none';
COMMENT ON COLUMN proposition_version.second_object_id IS 'its second argument; NULL: it has fewer';
CREATE TABLE replacement (
    kb_id bigint NOT NULL,
    number bigint NOT NULL,
    "position" integer NOT NULL,
    erasure_id bigint NOT NULL,
    salt bytea,
    commitment text COLLATE "C",
    CONSTRAINT ck_replacement_salt_or_commitment CHECK (((salt IS NULL) <> (commitment IS NULL))),
    CONSTRAINT fk_replacement_kb_id_number_position FOREIGN KEY (kb_id, number, "position") REFERENCES commitment(kb_id, number, "position"),
    CONSTRAINT pk_replacement PRIMARY KEY (kb_id, number, "position", erasure_id)
);
CREATE INDEX ix_replacement_erasure ON public.replacement USING btree (kb_id, erasure_id);
COMMENT ON COLUMN replacement.number IS 'the revision';
COMMENT ON COLUMN replacement."position" IS 'as in commitment';
COMMENT ON COLUMN replacement.erasure_id IS 'what erased it';
COMMENT ON COLUMN replacement.salt IS 'of the text that is there now; NULL: it was replaced again';
COMMENT ON COLUMN replacement.commitment IS 'to what was there; NULL: to the text that is there now';
CREATE TABLE request (
    kb_id bigint NOT NULL,
    key text COLLATE "C" NOT NULL,
    number bigint NOT NULL,
    digest text COLLATE "C" NOT NULL,
    results text COLLATE "C" NOT NULL,
    CONSTRAINT fk_request_kb_id_number FOREIGN KEY (kb_id, number) REFERENCES revision(kb_id, number),
    CONSTRAINT pk_request PRIMARY KEY (kb_id, key)
);
CREATE INDEX ix_request_number ON public.request USING btree (kb_id, number);
COMMENT ON COLUMN request.key IS 'SHA-256 of the token''s id and of the key that the client chose';
COMMENT ON COLUMN request.number IS 'the revision that it made';
COMMENT ON COLUMN request.digest IS 'SHA-256 of the client''s key and request';
COMMENT ON COLUMN request.results IS 'what its changes returned, as JSON: no names';
CREATE TABLE revision (
    kb_id bigint NOT NULL,
    number bigint NOT NULL,
    committed_at timestamp with time zone NOT NULL,
    actor text COLLATE "C",
    reason text COLLATE "C",
    source json,
    form integer NOT NULL,
    hash text COLLATE "C" NOT NULL,
    observed_at timestamp with time zone,
    seed bytea,
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
COMMENT ON COLUMN revision.observed_at IS 'UTC, when what it says was sensed; NULL: not said';
COMMENT ON COLUMN revision.seed IS '16 random bytes that the salts of its texts are made of; NULL: form 1, or erased';
CREATE TABLE revision_execution (
    kb_id bigint NOT NULL,
    number bigint NOT NULL,
    plan_id bigint NOT NULL,
    "position" integer NOT NULL,
    CONSTRAINT fk_revision_execution_kb_id_number FOREIGN KEY (kb_id, number) REFERENCES revision(kb_id, number),
    CONSTRAINT fk_revision_execution_kb_id_plan_id_position FOREIGN KEY (kb_id, plan_id, "position") REFERENCES execution(kb_id, plan_id, "position"),
    CONSTRAINT pk_revision_execution PRIMARY KEY (kb_id, number)
);
CREATE INDEX ix_revision_execution_execution ON public.revision_execution USING btree (kb_id, plan_id, "position", number);
COMMENT ON COLUMN revision_execution.number IS 'the revision';
CREATE TABLE rule (
    kb_id bigint NOT NULL,
    id bigint NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    key text COLLATE "C" NOT NULL,
    CONSTRAINT fk_rule_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_rule PRIMARY KEY (kb_id, id),
    CONSTRAINT uq_rule_kb_id_key UNIQUE (kb_id, key)
);
COMMENT ON COLUMN rule.name IS 'in its first spelling';
COMMENT ON COLUMN rule.key IS 'the name as compared: case folded';
CREATE TABLE rule_node (
    kb_id bigint NOT NULL,
    rule_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    parent integer,
    operator character varying(32) NOT NULL,
    predicate_id bigint,
    function_id bigint,
    value text COLLATE "C",
    CONSTRAINT ck_rule_node_function_given CHECK ((((operator)::text = 'function'::text) = (function_id IS NOT NULL))),
    CONSTRAINT ck_rule_node_one_root CHECK (((parent IS NULL) = ("position" = 0))),
    CONSTRAINT ck_rule_node_predicate_given CHECK ((((operator)::text = 'predicate'::text) = (predicate_id IS NOT NULL))),
    CONSTRAINT ck_rule_node_preorder CHECK ((parent < "position")),
    CONSTRAINT ck_rule_node_section CHECK (((section)::text = 'constraint'::text)),
    CONSTRAINT fk_rule_node_kb_id_function_id FOREIGN KEY (kb_id, function_id) REFERENCES function(kb_id, id),
    CONSTRAINT fk_rule_node_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT fk_rule_node_parent FOREIGN KEY (kb_id, rule_id, since, section, parent) REFERENCES rule_node(kb_id, rule_id, since, section, "position"),
    CONSTRAINT fk_rule_node_version FOREIGN KEY (kb_id, rule_id, since) REFERENCES rule_version(kb_id, rule_id, since),
    CONSTRAINT pk_rule_node PRIMARY KEY (kb_id, rule_id, since, section, "position")
);
CREATE INDEX ix_rule_node_function ON public.rule_node USING btree (kb_id, function_id);
CREATE INDEX ix_rule_node_predicate ON public.rule_node USING btree (kb_id, predicate_id);
COMMENT ON COLUMN rule_node.since IS 'asserted in this revision';
COMMENT ON COLUMN rule_node.section IS 'the part of its owner';
COMMENT ON COLUMN rule_node."position" IS 'from 0, in preorder';
COMMENT ON COLUMN rule_node.parent IS 'the position of the node above; NULL: the root';
COMMENT ON COLUMN rule_node.operator IS 'and, not, over all, increase, predicate, function, number ...';
COMMENT ON COLUMN rule_node.value IS 'a number as exact decimal text, a variable''s or a preference''s name';
CREATE TABLE rule_term (
    kb_id bigint NOT NULL,
    rule_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    term integer NOT NULL,
    parameter integer,
    object_id bigint,
    quantifier integer,
    variable integer,
    child integer,
    CONSTRAINT ck_rule_term_bound CHECK (((quantifier IS NULL) = (variable IS NULL))),
    CONSTRAINT ck_rule_term_no_parameter CHECK ((parameter IS NULL)),
    CONSTRAINT ck_rule_term_one_of_four CHECK (((((
CASE
    WHEN (parameter IS NULL) THEN 0
    ELSE 1
END +
CASE
    WHEN (object_id IS NULL) THEN 0
    ELSE 1
END) +
CASE
    WHEN (variable IS NULL) THEN 0
    ELSE 1
END) +
CASE
    WHEN (child IS NULL) THEN 0
    ELSE 1
END) = 1)),
    CONSTRAINT fk_rule_term_child FOREIGN KEY (kb_id, rule_id, since, section, child) REFERENCES rule_node(kb_id, rule_id, since, section, "position"),
    CONSTRAINT fk_rule_term_kb_id_object_id FOREIGN KEY (kb_id, object_id) REFERENCES object(kb_id, id),
    CONSTRAINT fk_rule_term_node FOREIGN KEY (kb_id, rule_id, since, section, "position") REFERENCES rule_node(kb_id, rule_id, since, section, "position"),
    CONSTRAINT fk_rule_term_variable FOREIGN KEY (kb_id, rule_id, since, section, quantifier, variable) REFERENCES rule_variable(kb_id, rule_id, since, section, "position", variable),
    CONSTRAINT pk_rule_term PRIMARY KEY (kb_id, rule_id, since, section, "position", term)
);
CREATE INDEX ix_rule_term_object ON public.rule_term USING btree (kb_id, object_id);
COMMENT ON COLUMN rule_term.since IS 'asserted in this revision';
COMMENT ON COLUMN rule_term.section IS 'the part of its owner';
COMMENT ON COLUMN rule_term."position" IS 'from 0, in preorder';
COMMENT ON COLUMN rule_term.term IS 'from 0';
COMMENT ON COLUMN rule_term.parameter IS 'the position of the owner''s parameter';
COMMENT ON COLUMN rule_term.object_id IS 'the constant';
COMMENT ON COLUMN rule_term.quantifier IS 'the position of the node that binds the variable';
COMMENT ON COLUMN rule_term.variable IS 'which of the quantifier''s variables it is';
COMMENT ON COLUMN rule_term.child IS 'the position of the function node whose value it is';
CREATE TABLE rule_variable (
    kb_id bigint NOT NULL,
    rule_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    variable integer NOT NULL,
    name character varying(255) COLLATE "C" NOT NULL,
    CONSTRAINT fk_rule_variable_node FOREIGN KEY (kb_id, rule_id, since, section, "position") REFERENCES rule_node(kb_id, rule_id, since, section, "position"),
    CONSTRAINT pk_rule_variable PRIMARY KEY (kb_id, rule_id, since, section, "position", variable)
);
COMMENT ON COLUMN rule_variable.since IS 'asserted in this revision';
COMMENT ON COLUMN rule_variable.section IS 'the part of its owner';
COMMENT ON COLUMN rule_variable."position" IS 'from 0, in preorder';
COMMENT ON COLUMN rule_variable.variable IS 'from 0';
COMMENT ON COLUMN rule_variable.name IS 'without its question mark';
CREATE TABLE rule_variable_type (
    kb_id bigint NOT NULL,
    rule_id bigint NOT NULL,
    since bigint NOT NULL,
    section character varying(24) NOT NULL,
    "position" integer NOT NULL,
    variable integer NOT NULL,
    alternative integer NOT NULL,
    type_id bigint NOT NULL,
    CONSTRAINT fk_rule_variable_type_kb_id_type_id FOREIGN KEY (kb_id, type_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_rule_variable_type_variable FOREIGN KEY (kb_id, rule_id, since, section, "position", variable) REFERENCES rule_variable(kb_id, rule_id, since, section, "position", variable),
    CONSTRAINT pk_rule_variable_type PRIMARY KEY (kb_id, rule_id, since, section, "position", variable, alternative)
);
CREATE INDEX ix_rule_variable_type_type ON public.rule_variable_type USING btree (kb_id, type_id);
COMMENT ON COLUMN rule_variable_type.since IS 'asserted in this revision';
COMMENT ON COLUMN rule_variable_type.section IS 'the part of its owner';
COMMENT ON COLUMN rule_variable_type."position" IS 'from 0, in preorder';
COMMENT ON COLUMN rule_variable_type.alternative IS 'from 0: several for either';
CREATE TABLE rule_version (
    kb_id bigint NOT NULL,
    rule_id bigint NOT NULL,
    since bigint NOT NULL,
    until bigint,
    on_violation character varying(16) NOT NULL,
    text text COLLATE "C" NOT NULL,
    CONSTRAINT ck_rule_version_on_violation CHECK (((on_violation)::text = ANY ((ARRAY['report'::character varying, 'refuse'::character varying])::text[]))),
    CONSTRAINT ck_rule_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_rule_version_kb_id_rule_id FOREIGN KEY (kb_id, rule_id) REFERENCES rule(kb_id, id),
    CONSTRAINT fk_rule_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_rule_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_rule_version PRIMARY KEY (kb_id, rule_id, since)
);
CREATE INDEX ix_rule_version_since ON public.rule_version USING btree (kb_id, since, rule_id);
CREATE INDEX ix_rule_version_until ON public.rule_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_rule_version_live ON public.rule_version USING btree (kb_id, rule_id) WHERE (until IS NULL);
COMMENT ON COLUMN rule_version.since IS 'asserted in this revision';
COMMENT ON COLUMN rule_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN rule_version.on_violation IS 'report; refuse: the transaction fails';
COMMENT ON COLUMN rule_version.text IS 'canonical PDDL';
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
CREATE TABLE type_parent (
    kb_id bigint NOT NULL,
    type_id bigint NOT NULL,
    since bigint NOT NULL,
    "position" integer NOT NULL,
    parent_id bigint NOT NULL,
    CONSTRAINT fk_type_parent_kb_id_parent_id FOREIGN KEY (kb_id, parent_id) REFERENCES type(kb_id, id),
    CONSTRAINT fk_type_parent_kb_id_type_id_since FOREIGN KEY (kb_id, type_id, since) REFERENCES type_version(kb_id, type_id, since),
    CONSTRAINT pk_type_parent PRIMARY KEY (kb_id, type_id, since, "position")
);
CREATE INDEX ix_type_parent_parent ON public.type_parent USING btree (kb_id, parent_id);
COMMENT ON COLUMN type_parent.since IS 'asserted in this revision';
COMMENT ON COLUMN type_parent."position" IS 'from 1: the first is in the version';
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
CREATE INDEX ix_type_version_since ON public.type_version USING btree (kb_id, since, type_id);
CREATE INDEX ix_type_version_until ON public.type_version USING btree (kb_id, until) WHERE (until IS NOT NULL);
CREATE UNIQUE INDEX uq_type_version_live ON public.type_version USING btree (kb_id, type_id) WHERE (until IS NULL);
COMMENT ON COLUMN type_version.since IS 'asserted in this revision';
COMMENT ON COLUMN type_version.until IS 'retracted in this revision; NULL: holds now';
COMMENT ON COLUMN type_version.parent_id IS 'the type above it; NULL: right under the root';
COMMENT ON COLUMN type_version.text IS 'canonical PDDL';
CREATE TABLE verification (
    kb_id bigint NOT NULL,
    revision bigint NOT NULL,
    hash text COLLATE "C" NOT NULL,
    verified_at timestamp with time zone NOT NULL,
    complete_at timestamp with time zone,
    CONSTRAINT fk_verification_kb_id FOREIGN KEY (kb_id) REFERENCES knowledge_base(id),
    CONSTRAINT pk_verification PRIMARY KEY (kb_id)
);
COMMENT ON COLUMN verification.revision IS 'verified up to this revision';
COMMENT ON COLUMN verification.hash IS 'of that revision, at that time';
COMMENT ON COLUMN verification.verified_at IS 'UTC, when that was';
COMMENT ON COLUMN verification.complete_at IS 'UTC, when a verification that began at revision 1 last ended; NULL: none did';
CREATE VIEW audit_action (
    knowledge_base character varying(255) COLLATE "C",
    action character varying(255) COLLATE "C",
    action_id bigint,
    kind text COLLATE "C",
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    a.name AS action,
    v.action_id,
    v.kind::text COLLATE "C" AS kind,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM action_version v
     LEFT JOIN action a ON a.kb_id = v.kb_id AND a.id = v.action_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_action_literal (
    knowledge_base character varying(255) COLLATE "C",
    action character varying(255) COLLATE "C",
    action_id bigint,
    kind text COLLATE "C",
    section text COLLATE "C",
    "position" integer,
    role text COLLATE "C",
    predicate character varying(255) COLLATE "C",
    literal text COLLATE "C",
    "time" text COLLATE "C",
    is_conditional boolean,
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    a.name AS action,
    n.action_id,
    v.kind::text COLLATE "C" AS kind,
    n.section::text COLLATE "C" AS section,
    n."position",
    ( WITH RECURSIVE walk("position", above, is_denied, asserted, denied, "time", is_need) AS (
                 SELECT n."position",
                    n.parent,
                    0 AS "?column?",
                    0 AS "?column?",
                    0 AS "?column?",
                    NULL::character varying(32) AS "varchar",
                        CASE
                            WHEN n.section::text = 'condition'::text THEN 1
                            ELSE 0
                        END AS "case"
                UNION ALL
                 SELECT m."position",
                    m.parent,
                        CASE
                            WHEN m.operator::text = 'not'::text OR m.operator::text = 'imply'::text AND walk_1."position" = (m."position" + 1) THEN 1 - walk_1.is_denied
                            ELSE walk_1.is_denied
                        END AS is_denied,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['or'::character varying, 'imply'::character varying, 'exists'::character varying, 'forall'::character varying, 'when'::character varying, 'preference'::character varying]::text[]) THEN 1
                            WHEN m.operator::text = 'not'::text THEN walk_1.denied
                            ELSE walk_1.asserted
                        END AS asserted,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['and'::character varying, 'exists'::character varying, 'forall'::character varying, 'when'::character varying, 'preference'::character varying]::text[]) THEN 1
                            WHEN m.operator::text = 'not'::text OR m.operator::text = 'imply'::text AND walk_1."position" = (m."position" + 1) THEN walk_1.asserted
                            ELSE walk_1.denied
                        END AS denied,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['at start'::character varying, 'over all'::character varying, 'at end'::character varying]::text[]) THEN m.operator
                            ELSE walk_1."time"
                        END AS "time",
                        CASE
                            WHEN m.operator::text = 'when'::text AND walk_1."position" = (m."position" + 1) THEN 1
                            ELSE walk_1.is_need
                        END AS is_need
                   FROM walk walk_1
                     JOIN action_node m ON m.kb_id = n.kb_id AND m.action_id = n.action_id AND m.since = n.since AND m.section::text = n.section::text AND m."position" = walk_1.above
                )
         SELECT
                CASE
                    WHEN walk.is_need = 1 THEN
                    CASE
                        WHEN walk.is_denied = 0 THEN 'needs'::text COLLATE "C"
                        ELSE 'needs not'::text COLLATE "C"
                    END
                    ELSE
                    CASE
                        WHEN walk.is_denied = 0 THEN 'adds'::text COLLATE "C"
                        ELSE 'deletes'::text COLLATE "C"
                    END
                END AS "case"
           FROM walk
          WHERE walk.above IS NULL) AS role,
    d.name AS predicate,
    ( WITH RECURSIVE spell("position", term, text) AS (
                 SELECT n."position",
                    0 AS "?column?",
                    '('::text || d.name::text AS "?column?"
                UNION ALL
                 SELECT
                        CASE
                            WHEN t.child IS NOT NULL THEN t.child
                            WHEN t.term IS NULL THEN o."position"
                            ELSE spell_1."position"
                        END AS "position",
                        CASE
                            WHEN t.child IS NOT NULL THEN 0
                            WHEN t.term IS NULL THEN o.term + 1
                            ELSE spell_1.term + 1
                        END AS "case",
                    spell_1.text ||
                        CASE
                            WHEN t.term IS NULL THEN ')'::text
                            WHEN t.child IS NOT NULL THEN ' ('::text || ((( SELECT f.name
                               FROM action_node c
                                 JOIN function f ON f.kb_id = c.kb_id AND f.id = c.function_id
                              WHERE c.kb_id = n.kb_id AND c.action_id = n.action_id AND c.since = n.since AND c.section::text = n.section::text AND c."position" = t.child))::text)
                            WHEN t.object_id IS NOT NULL THEN ' '::text || ((( SELECT e.name
                               FROM object e
                              WHERE e.kb_id = n.kb_id AND e.id = t.object_id))::text)
                            WHEN t.parameter IS NOT NULL THEN ' ?'::text || ((( SELECT q.name
                               FROM action_parameter q
                              WHERE q.kb_id = n.kb_id AND q.action_id = n.action_id AND q.since = n.since AND q."position" = t.parameter))::text)
                            ELSE ' ?'::text || ((( SELECT b.name
                               FROM action_variable b
                              WHERE b.kb_id = n.kb_id AND b.action_id = n.action_id AND b.since = n.since AND b.section::text = n.section::text AND b."position" = t.quantifier AND b.variable = t.variable))::text)
                        END
                   FROM spell spell_1
                     LEFT JOIN action_term t ON t.kb_id = n.kb_id AND t.action_id = n.action_id AND t.since = n.since AND t.section::text = n.section::text AND t."position" = spell_1."position" AND t.term = spell_1.term
                     LEFT JOIN action_term o ON t.term IS NULL AND o.kb_id = n.kb_id AND o.action_id = n.action_id AND o.since = n.since AND o.section::text = n.section::text AND o.child = spell_1."position"
                  WHERE spell_1."position" IS NOT NULL
                )
         SELECT spell.text
           FROM spell
          WHERE spell."position" IS NULL) AS literal,
    ( WITH RECURSIVE walk("position", above, is_denied, asserted, denied, "time", is_need) AS (
                 SELECT n."position",
                    n.parent,
                    0 AS "?column?",
                    0 AS "?column?",
                    0 AS "?column?",
                    NULL::character varying(32) AS "varchar",
                        CASE
                            WHEN n.section::text = 'condition'::text THEN 1
                            ELSE 0
                        END AS "case"
                UNION ALL
                 SELECT m."position",
                    m.parent,
                        CASE
                            WHEN m.operator::text = 'not'::text OR m.operator::text = 'imply'::text AND walk_1."position" = (m."position" + 1) THEN 1 - walk_1.is_denied
                            ELSE walk_1.is_denied
                        END AS is_denied,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['or'::character varying, 'imply'::character varying, 'exists'::character varying, 'forall'::character varying, 'when'::character varying, 'preference'::character varying]::text[]) THEN 1
                            WHEN m.operator::text = 'not'::text THEN walk_1.denied
                            ELSE walk_1.asserted
                        END AS asserted,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['and'::character varying, 'exists'::character varying, 'forall'::character varying, 'when'::character varying, 'preference'::character varying]::text[]) THEN 1
                            WHEN m.operator::text = 'not'::text OR m.operator::text = 'imply'::text AND walk_1."position" = (m."position" + 1) THEN walk_1.asserted
                            ELSE walk_1.denied
                        END AS denied,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['at start'::character varying, 'over all'::character varying, 'at end'::character varying]::text[]) THEN m.operator
                            ELSE walk_1."time"
                        END AS "time",
                        CASE
                            WHEN m.operator::text = 'when'::text AND walk_1."position" = (m."position" + 1) THEN 1
                            ELSE walk_1.is_need
                        END AS is_need
                   FROM walk walk_1
                     JOIN action_node m ON m.kb_id = n.kb_id AND m.action_id = n.action_id AND m.since = n.since AND m.section::text = n.section::text AND m."position" = walk_1.above
                )
         SELECT walk."time"::text COLLATE "C" AS "time"
           FROM walk
          WHERE walk.above IS NULL) AS "time",
    ( WITH RECURSIVE walk("position", above, is_denied, asserted, denied, "time", is_need) AS (
                 SELECT n."position",
                    n.parent,
                    0 AS "?column?",
                    0 AS "?column?",
                    0 AS "?column?",
                    NULL::character varying(32) AS "varchar",
                        CASE
                            WHEN n.section::text = 'condition'::text THEN 1
                            ELSE 0
                        END AS "case"
                UNION ALL
                 SELECT m."position",
                    m.parent,
                        CASE
                            WHEN m.operator::text = 'not'::text OR m.operator::text = 'imply'::text AND walk_1."position" = (m."position" + 1) THEN 1 - walk_1.is_denied
                            ELSE walk_1.is_denied
                        END AS is_denied,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['or'::character varying, 'imply'::character varying, 'exists'::character varying, 'forall'::character varying, 'when'::character varying, 'preference'::character varying]::text[]) THEN 1
                            WHEN m.operator::text = 'not'::text THEN walk_1.denied
                            ELSE walk_1.asserted
                        END AS asserted,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['and'::character varying, 'exists'::character varying, 'forall'::character varying, 'when'::character varying, 'preference'::character varying]::text[]) THEN 1
                            WHEN m.operator::text = 'not'::text OR m.operator::text = 'imply'::text AND walk_1."position" = (m."position" + 1) THEN walk_1.asserted
                            ELSE walk_1.denied
                        END AS denied,
                        CASE
                            WHEN m.operator::text = ANY (ARRAY['at start'::character varying, 'over all'::character varying, 'at end'::character varying]::text[]) THEN m.operator
                            ELSE walk_1."time"
                        END AS "time",
                        CASE
                            WHEN m.operator::text = 'when'::text AND walk_1."position" = (m."position" + 1) THEN 1
                            ELSE walk_1.is_need
                        END AS is_need
                   FROM walk walk_1
                     JOIN action_node m ON m.kb_id = n.kb_id AND m.action_id = n.action_id AND m.since = n.since AND m.section::text = n.section::text AND m."position" = walk_1.above
                )
         SELECT walk.asserted = 1
           FROM walk
          WHERE walk.above IS NULL) AS is_conditional,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    n.kb_id
   FROM action_node n
     JOIN action_version v ON v.kb_id = n.kb_id AND v.action_id = n.action_id AND v.since = n.since
     LEFT JOIN action a ON a.kb_id = n.kb_id AND a.id = n.action_id
     LEFT JOIN predicate d ON d.kb_id = n.kb_id AND d.id = n.predicate_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
  WHERE n.predicate_id IS NOT NULL;
CREATE VIEW audit_archive (
    knowledge_base character varying(255) COLLATE "C",
    archive_id bigint,
    revision bigint,
    revision_at timestamp with time zone,
    revision_epoch double precision,
    target text COLLATE "C",
    versions bigint,
    rest text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    text text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.id AS archive_id,
    v.revision,
    r.committed_at AS revision_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS revision_epoch,
    v.target,
    v.versions,
    v.rest,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.kb_id
   FROM archive v
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.revision
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_change (
    knowledge_base character varying(255) COLLATE "C",
    revision bigint,
    sign text COLLATE "C",
    kind text COLLATE "C",
    text text COLLATE "C",
    element_id bigint,
    committed_at timestamp with time zone,
    committed_epoch double precision,
    committed_hour text COLLATE "C",
    observed_at timestamp with time zone,
    observed_epoch double precision,
    delay double precision,
    actor text COLLATE "C",
    reason text COLLATE "C",
    source text COLLATE "C",
    plan_id bigint,
    plan_step integer,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'type'::text COLLATE "C" AS kind,
    v.text,
    v.type_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM type_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'object'::text COLLATE "C" AS kind,
    v.text,
    v.object_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM object_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'predicate'::text COLLATE "C" AS kind,
    v.text,
    v.predicate_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM predicate_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'function'::text COLLATE "C" AS kind,
    v.text,
    v.function_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM function_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'action'::text COLLATE "C" AS kind,
    v.text,
    v.action_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM action_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    v.section::text COLLATE "C" AS kind,
    v.text,
    v.formula_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM formula_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'document'::text COLLATE "C" AS kind,
    v.text,
    v.document_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM document_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'fact'::text COLLATE "C" AS kind,
    p.text,
    v.proposition_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM proposition_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
  WHERE NOT v.is_goal
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'goal'::text COLLATE "C" AS kind,
    p.text,
    v.proposition_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM proposition_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
  WHERE v.is_goal
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'value'::text COLLATE "C" AS kind,
    v.text,
    v.function_value_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM function_value_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'plan'::text COLLATE "C" AS kind,
    v.text,
    v.id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM plan v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    v.kind::text COLLATE "C" AS kind,
    v.text,
        CASE v.plan_id
            WHEN 0 THEN v."position"::bigint
            ELSE v.plan_id
        END AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM execution_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'archive'::text COLLATE "C" AS kind,
    v.text,
    v.id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM archive v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'type'::text COLLATE "C" AS kind,
    v.text,
    v.type_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM type_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'object'::text COLLATE "C" AS kind,
    v.text,
    v.object_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM object_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'predicate'::text COLLATE "C" AS kind,
    v.text,
    v.predicate_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM predicate_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'function'::text COLLATE "C" AS kind,
    v.text,
    v.function_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM function_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'action'::text COLLATE "C" AS kind,
    v.text,
    v.action_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM action_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    v.section::text COLLATE "C" AS kind,
    v.text,
    v.formula_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM formula_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'document'::text COLLATE "C" AS kind,
    v.text,
    v.document_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM document_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'fact'::text COLLATE "C" AS kind,
    p.text,
    v.proposition_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM proposition_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE NOT v.is_goal AND v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'goal'::text COLLATE "C" AS kind,
    p.text,
    v.proposition_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM proposition_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.is_goal AND COALESCE(v.until, 0::bigint) > 0
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'value'::text COLLATE "C" AS kind,
    v.text,
    v.function_value_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM function_value_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    v.kind::text COLLATE "C" AS kind,
    v.text,
        CASE v.plan_id
            WHEN 0 THEN v."position"::bigint
            ELSE v.plan_id
        END AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM execution_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'promotion'::text COLLATE "C" AS kind,
    v.text,
    v.id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM promotion v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'confirmation'::text COLLATE "C" AS kind,
    p.text,
    v.proposition_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM confirmation v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'rule'::text COLLATE "C" AS kind,
    v.text,
    v.rule_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM rule_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.until AS revision,
    '-'::text COLLATE "C" AS sign,
    'rule'::text COLLATE "C" AS kind,
    v.text,
    v.rule_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM rule_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.until
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.until
  WHERE v.until IS NOT NULL
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'saying'::text COLLATE "C" AS kind,
    v.text,
    v.proposition_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM proposition_saying v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'saying'::text COLLATE "C" AS kind,
    v.text,
    v.function_value_id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM function_value_saying v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since
UNION ALL
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    '+'::text COLLATE "C" AS sign,
    'erasure'::text COLLATE "C" AS kind,
    v.text,
    v.id AS element_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM erasure v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since;
CREATE VIEW audit_confirmation (
    knowledge_base character varying(255) COLLATE "C",
    revision bigint,
    text text COLLATE "C",
    proposition_id bigint,
    committed_at timestamp with time zone,
    committed_epoch double precision,
    committed_hour text COLLATE "C",
    observed_at timestamp with time zone,
    observed_epoch double precision,
    delay double precision,
    actor text COLLATE "C",
    reason text COLLATE "C",
    source text COLLATE "C",
    plan_id bigint,
    plan_step integer,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.since AS revision,
    p.text,
    v.proposition_id,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    v.kb_id
   FROM confirmation v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.since
     LEFT JOIN revision_execution x ON x.kb_id = v.kb_id AND x.number = v.since;
CREATE VIEW audit_definition (
    knowledge_base character varying(255) COLLATE "C",
    kind text COLLATE "C",
    name character varying(255) COLLATE "C",
    element_id bigint,
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    'type'::text COLLATE "C" AS kind,
    n.name,
    v.type_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM type_version v
     LEFT JOIN type n ON n.kb_id = v.kb_id AND n.id = v.type_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
 SELECT k.name AS knowledge_base,
    'object'::text COLLATE "C" AS kind,
    n.name,
    v.object_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM object_version v
     LEFT JOIN object n ON n.kb_id = v.kb_id AND n.id = v.object_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
 SELECT k.name AS knowledge_base,
    'predicate'::text COLLATE "C" AS kind,
    n.name,
    v.predicate_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM predicate_version v
     LEFT JOIN predicate n ON n.kb_id = v.kb_id AND n.id = v.predicate_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
 SELECT k.name AS knowledge_base,
    'function'::text COLLATE "C" AS kind,
    n.name,
    v.function_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM function_version v
     LEFT JOIN function n ON n.kb_id = v.kb_id AND n.id = v.function_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
 SELECT k.name AS knowledge_base,
    'action'::text COLLATE "C" AS kind,
    n.name,
    v.action_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM action_version v
     LEFT JOIN action n ON n.kb_id = v.kb_id AND n.id = v.action_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
 SELECT k.name AS knowledge_base,
    v.section::text COLLATE "C" AS kind,
    n.name,
    v.formula_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM formula_version v
     LEFT JOIN formula n ON n.kb_id = v.kb_id AND n.id = v.formula_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
 SELECT k.name AS knowledge_base,
    'document'::text COLLATE "C" AS kind,
    n.name,
    v.document_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM document_version v
     LEFT JOIN document n ON n.kb_id = v.kb_id AND n.id = v.document_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
UNION ALL
 SELECT k.name AS knowledge_base,
    'rule'::text COLLATE "C" AS kind,
    n.name,
    v.rule_id AS element_id,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM rule_version v
     LEFT JOIN rule n ON n.kb_id = v.kb_id AND n.id = v.rule_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_effect (
    knowledge_base character varying(255) COLLATE "C",
    execution text COLLATE "C",
    plan_id bigint,
    "position" integer,
    proposition_id bigint,
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    asserted_by text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    retracted_by text COLLATE "C",
    confirmed bigint,
    confirmed_at timestamp with time zone,
    confirmed_epoch double precision,
    confirmed_by text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.execution,
    v.plan_id,
    v."position",
    v.proposition_id,
    p.text,
    v.since,
    v.since_at,
    EXTRACT(epoch FROM v.since_at)::double precision AS since_epoch,
    v.asserted_by,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.actor AS retracted_by,
    v.confirmed,
    r.committed_at AS confirmed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS confirmed_epoch,
    r.actor AS confirmed_by,
    v.kb_id
   FROM ( SELECT w.kb_id,
                CASE
                    WHEN w.plan_id = 0 THEN (w."position"::text COLLATE "C") || ''::text
                    ELSE ((w.plan_id::text COLLATE "C") || '.'::text) || (w."position"::text COLLATE "C")
                END AS execution,
            w.plan_id,
            w."position",
            f.proposition_id,
            f.since,
            f.until,
            s.committed_at AS since_at,
            s.actor AS asserted_by,
            ( SELECT max(c.since) AS max
                   FROM confirmation c
                     JOIN revision q ON q.kb_id = c.kb_id AND q.number = c.since
                  WHERE c.kb_id = f.kb_id AND c.proposition_id = f.proposition_id AND c.since > f.since AND (f.until IS NULL OR c.since <= f.until) AND COALESCE(q.actor, ''::text) <> COALESCE(s.actor, ''::text)) AS confirmed
           FROM ( SELECT execution_version.kb_id,
                    execution_version.plan_id,
                    execution_version."position",
                    execution_version.since
                   FROM execution_version
                  WHERE execution_version.outcome::text = ANY (ARRAY['running'::character varying, 'succeeded'::character varying]::text[])
                UNION
                 SELECT revision_execution.kb_id,
                    revision_execution.plan_id,
                    revision_execution."position",
                    revision_execution.number
                   FROM revision_execution) w
             JOIN proposition_version f ON f.kb_id = w.kb_id AND f.since = w.since
             JOIN revision s ON s.kb_id = f.kb_id AND s.number = f.since
          WHERE NOT f.is_goal) v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.confirmed;
CREATE VIEW audit_erasure (
    knowledge_base character varying(255) COLLATE "C",
    erasure_id bigint,
    revision bigint,
    revision_at timestamp with time zone,
    revision_epoch double precision,
    kind character varying(16),
    element_id bigint,
    pseudonym text COLLATE "C",
    parts bigint,
    digest text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    text text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.id AS erasure_id,
    v.revision,
    r.committed_at AS revision_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS revision_epoch,
    v.kind,
    v.element_id,
    v.pseudonym,
    v.parts,
    v.digest,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.kb_id
   FROM erasure v
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.revision
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_execution (
    knowledge_base character varying(255) COLLATE "C",
    execution text COLLATE "C",
    plan_id bigint,
    "position" integer,
    action character varying COLLATE "C",
    arguments text COLLATE "C",
    text text COLLATE "C",
    outcome text COLLATE "C",
    code text COLLATE "C",
    message text COLLATE "C",
    started bigint,
    started_at timestamp with time zone,
    started_epoch double precision,
    started_by text COLLATE "C",
    started_reason text COLLATE "C",
    started_source text COLLATE "C",
    ended bigint,
    ended_at timestamp with time zone,
    ended_epoch double precision,
    ended_by text COLLATE "C",
    ended_reason text COLLATE "C",
    duration double precision,
    planned_duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.execution,
    v.plan_id,
    v."position",
    v.action,
    v.arguments,
    v.text,
    v.outcome,
    v.code,
    v.message,
    v.started,
    v.started_at,
    EXTRACT(epoch FROM v.started_at)::double precision AS started_epoch,
    v.started_by,
    v.started_reason,
    v.started_source::text COLLATE "C" AS started_source,
    v.ended,
    v.ended_at,
    EXTRACT(epoch FROM v.ended_at)::double precision AS ended_epoch,
    v.ended_by,
    v.ended_reason,
    EXTRACT(epoch FROM v.ended_at - v.started_at)::double precision AS duration,
    v.planned_duration::double precision AS planned_duration,
    v.kb_id
   FROM ( SELECT e.kb_id,
                CASE
                    WHEN e.plan_id = 0 THEN (e."position"::text COLLATE "C") || ''::text
                    ELSE ((e.plan_id::text COLLATE "C") || '.'::text) || (e."position"::text COLLATE "C")
                END AS execution,
            e.plan_id,
            e."position",
            COALESCE(a.name, e.name::character varying) AS action,
                CASE
                    WHEN e.name IS NULL THEN rtrim(substr(e.text, length(a.name::text) + 3), ')'::text)
                    ELSE ( SELECT string_agg(h.said::text, ' '::text) AS string_agg
                       FROM ( SELECT COALESCE(o.name, g.value::character varying) AS said
                               FROM execution_argument g
                                 LEFT JOIN object o ON o.kb_id = g.kb_id AND o.id = g.object_id
                              WHERE g.kb_id = e.kb_id AND g.plan_id = e.plan_id AND g."position" = e."position"
                              ORDER BY g.argument) h)
                END AS arguments,
            e.text,
            w.outcome::text COLLATE "C" AS outcome,
            w.code,
            w.message,
                CASE e.plan_id
                    WHEN 0 THEN e.since
                    ELSE b.since
                END AS started,
            COALESCE(w.started_at, s.committed_at) AS started_at,
            s.actor AS started_by,
            s.reason AS started_reason,
            s.source AS started_source,
            u.number AS ended,
                CASE
                    WHEN u.number IS NOT NULL THEN COALESCE(w.ended_at, u.committed_at)
                    ELSE NULL::timestamp with time zone
                END AS ended_at,
            u.actor AS ended_by,
            u.reason AS ended_reason,
            e.duration AS planned_duration
           FROM execution e
             JOIN execution_version w ON w.kb_id = e.kb_id AND w.plan_id = e.plan_id AND w."position" = e."position" AND w.until IS NULL
             LEFT JOIN execution_version b ON b.kb_id = e.kb_id AND b.plan_id = e.plan_id AND b."position" = e."position" AND b.since = (( SELECT min(c.since) AS min
                   FROM execution_version c
                  WHERE c.kb_id = e.kb_id AND c.plan_id = e.plan_id AND c."position" = e."position"))
             LEFT JOIN action a ON a.kb_id = e.kb_id AND a.id = e.action_id
             LEFT JOIN revision s ON s.kb_id = e.kb_id AND s.number =
                CASE e.plan_id
                    WHEN 0 THEN e.since
                    ELSE b.since
                END
             LEFT JOIN revision u ON u.kb_id = w.kb_id AND u.number = w.since AND w.outcome::text <> 'running'::text) v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id;
CREATE VIEW audit_fact (
    knowledge_base character varying(255) COLLATE "C",
    kind text COLLATE "C",
    proposition_id bigint,
    predicate character varying(255) COLLATE "C",
    arguments text COLLATE "C",
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
        CASE
            WHEN v.is_goal THEN 'goal'::text COLLATE "C"
            ELSE 'fact'::text COLLATE "C"
        END AS kind,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name::text) + 3), ')'::text) AS arguments,
    p.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM proposition_version v
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN predicate d ON d.kb_id = v.kb_id AND d.id = v.predicate_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_fact_argument (
    knowledge_base character varying(255) COLLATE "C",
    kind text COLLATE "C",
    proposition_id bigint,
    predicate character varying(255) COLLATE "C",
    text text COLLATE "C",
    "position" integer,
    parameter character varying(255) COLLATE "C",
    object character varying(255) COLLATE "C",
    object_id bigint,
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
        CASE
            WHEN v.is_goal THEN 'goal'::text COLLATE "C"
            ELSE 'fact'::text COLLATE "C"
        END AS kind,
    v.proposition_id,
    d.name AS predicate,
    p.text,
    a."position",
    ( SELECT m.name
           FROM predicate_version w
             JOIN predicate_parameter m ON m.kb_id = w.kb_id AND m.predicate_id = w.predicate_id AND m.since = w.since
          WHERE w.kb_id = v.kb_id AND w.predicate_id = v.predicate_id AND w.since <= v.since AND (w.until IS NULL OR w.until > v.since) AND m."position" = a."position") AS parameter,
    o.name AS object,
    a.object_id,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM proposition_version v
     JOIN proposition_argument a ON a.kb_id = v.kb_id AND a.proposition_id = v.proposition_id
     LEFT JOIN object o ON o.kb_id = a.kb_id AND o.id = a.object_id
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN predicate d ON d.kb_id = v.kb_id AND d.id = v.predicate_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_fact_valid (
    knowledge_base character varying(255) COLLATE "C",
    proposition_id bigint,
    predicate character varying(255) COLLATE "C",
    arguments text COLLATE "C",
    text text COLLATE "C",
    valid_from timestamp with time zone,
    valid_from_epoch double precision,
    valid_until timestamp with time zone,
    valid_until_epoch double precision,
    known_since bigint,
    known_since_at timestamp with time zone,
    known_since_epoch double precision,
    known_by text COLLATE "C",
    known_reason text COLLATE "C",
    known_until bigint,
    known_until_at timestamp with time zone,
    known_until_epoch double precision,
    corrected_by text COLLATE "C",
    corrected_reason text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name::text) + 3), ')'::text) AS arguments,
    p.text,
    v.valid_from,
    EXTRACT(epoch FROM v.valid_from)::double precision AS valid_from_epoch,
    v.valid_until,
    EXTRACT(epoch FROM v.valid_until)::double precision AS valid_until_epoch,
    v.known_since,
    s.committed_at AS known_since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS known_since_epoch,
    s.actor AS known_by,
    s.reason AS known_reason,
    v.known_until,
    u.committed_at AS known_until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS known_until_epoch,
    u.actor AS corrected_by,
    u.reason AS corrected_reason,
    v.kb_id
   FROM ( SELECT w.kb_id,
            w.proposition_id,
            w.predicate_id,
            s_1.committed_at AS valid_from,
            u_1.committed_at AS valid_until,
            w.since AS known_since,
            NULL::bigint AS known_until
           FROM proposition_version w
             JOIN revision s_1 ON s_1.kb_id = w.kb_id AND s_1.number = w.since
             LEFT JOIN revision u_1 ON u_1.kb_id = w.kb_id AND u_1.number = w.until
          WHERE NOT w.is_goal AND COALESCE(s_1.committed_at < u_1.committed_at, w.until IS NULL) AND NOT (EXISTS ( SELECT 1
                   FROM proposition_saying l
                  WHERE l.kb_id = w.kb_id AND l.proposition_id = w.proposition_id))
        UNION ALL
         SELECT w.kb_id,
            w.proposition_id,
            w.predicate_id,
            u_1.committed_at AS valid_from,
            NULL::timestamp with time zone AS valid_until,
            w.since AS known_since,
            w.until AS known_until
           FROM proposition_version w
             JOIN revision u_1 ON u_1.kb_id = w.kb_id AND u_1.number = w.until
          WHERE NOT w.is_goal
        UNION ALL
         SELECT w.kb_id,
            w.proposition_id,
            w.predicate_id,
            w.valid_from,
            w.valid_until,
            w.since AS known_since,
            w.known_until
           FROM ( SELECT e.kb_id,
                    e.proposition_id,
                    e.predicate_id,
                    e.since,
                    e.begun,
                    e.ended,
                    e.holds,
                    g.valid_from,
                    g.valid_until,
                    lead(e.since) OVER (PARTITION BY e.kb_id, e.proposition_id, g.valid_from ORDER BY e.since) AS known_until
                   FROM ( SELECT m.kb_id,
                            m.proposition_id,
                            m.moment AS valid_from,
                            lead(m.moment) OVER (PARTITION BY m.kb_id, m.proposition_id ORDER BY m.moment) AS valid_until
                           FROM ( SELECT l.kb_id,
                                    l.proposition_id,
                                    l.valid_from AS moment
                                   FROM proposition_saying l
                                UNION
                                 SELECT l.kb_id,
                                    l.proposition_id,
                                    l.valid_until
                                   FROM proposition_saying l
                                UNION
                                 SELECT n.kb_id,
                                    n.proposition_id,
                                    q.committed_at
                                   FROM proposition_version n
                                     JOIN revision q ON q.kb_id = n.kb_id AND (q.number = n.since OR q.number = n.until)
                                  WHERE (EXISTS ( SELECT 1
   FROM proposition_saying l
  WHERE l.kb_id = n.kb_id AND l.proposition_id = n.proposition_id))) m) g
                     JOIN ( SELECT l.kb_id,
                            l.proposition_id,
                            l.predicate_id,
                            l.since,
                            l.valid_from AS begun,
                            l.valid_until AS ended,
                            l.holds
                           FROM proposition_saying l
                        UNION ALL
                         SELECT w_1.kb_id,
                            w_1.proposition_id,
                            w_1.predicate_id,
                            w_1.since,
                            s_1.committed_at,
                            u_1.committed_at,
                            true
                           FROM proposition_version w_1
                             JOIN revision s_1 ON s_1.kb_id = w_1.kb_id AND s_1.number = w_1.since
                             LEFT JOIN revision u_1 ON u_1.kb_id = w_1.kb_id AND u_1.number = w_1.until
                          WHERE NOT w_1.is_goal AND (EXISTS ( SELECT 1
                                   FROM proposition_saying l
                                  WHERE l.kb_id = w_1.kb_id AND l.proposition_id = w_1.proposition_id))) e ON e.kb_id = g.kb_id AND e.proposition_id = g.proposition_id AND e.begun <= g.valid_from AND COALESCE(g.valid_from < e.ended, true)) w
          WHERE w.holds) v
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN predicate d ON d.kb_id = v.kb_id AND d.id = v.predicate_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.known_since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.known_until;
CREATE VIEW audit_goal (
    knowledge_base character varying(255) COLLATE "C",
    kind text COLLATE "C",
    proposition_id bigint,
    predicate character varying(255) COLLATE "C",
    arguments text COLLATE "C",
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
        CASE
            WHEN v.is_goal THEN 'goal'::text COLLATE "C"
            ELSE 'fact'::text COLLATE "C"
        END AS kind,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name::text) + 3), ')'::text) AS arguments,
    p.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM proposition_version v
     LEFT JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
     LEFT JOIN predicate d ON d.kb_id = v.kb_id AND d.id = v.predicate_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
  WHERE v.is_goal;
CREATE VIEW audit_knowledge_base (
    knowledge_base character varying(255) COLLATE "C",
    revision bigint,
    committed_at timestamp with time zone,
    committed_epoch double precision,
    origin text COLLATE "C",
    verified_revision bigint,
    verified_at timestamp with time zone,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    h.revision,
    h.committed_at,
    EXTRACT(epoch FROM h.committed_at)::double precision AS committed_epoch,
    h.origin,
    c.revision AS verified_revision,
    c.verified_at,
    h.kb_id
   FROM head h
     JOIN knowledge_base k ON k.id = h.kb_id
     LEFT JOIN verification c ON c.kb_id = h.kb_id;
CREATE VIEW audit_object (
    knowledge_base character varying(255) COLLATE "C",
    object character varying(255) COLLATE "C",
    object_id bigint,
    type text COLLATE "C",
    is_constant boolean,
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    o.name AS object,
    v.object_id,
        CASE
            WHEN v.is_constant THEN substr(v.text, length(o.name::text) + 16, length(v.text) - length(o.name::text) - 16)
            ELSE substr(v.text, length(o.name::text) + 4)
        END AS type,
    v.is_constant,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM object_version v
     LEFT JOIN object o ON o.kb_id = v.kb_id AND o.id = v.object_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_plan (
    knowledge_base character varying(255) COLLATE "C",
    plan_id bigint,
    revision bigint,
    revision_at timestamp with time zone,
    revision_epoch double precision,
    problem_hash text COLLATE "C",
    planner text COLLATE "C",
    planner_version text COLLATE "C",
    objective text COLLATE "C",
    value text COLLATE "C",
    number double precision,
    status text COLLATE "C",
    steps bigint,
    steps_running bigint,
    steps_succeeded bigint,
    steps_failed bigint,
    steps_aborted bigint,
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    text text COLLATE "C",
    domain_pddl text COLLATE "C",
    problem_pddl text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.id AS plan_id,
    v.revision,
    r.committed_at AS revision_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS revision_epoch,
    v.problem_hash,
    v.planner,
    v.planner_version,
    v.objective,
    v.value,
    v.value::double precision AS number,
    v.status,
    ( SELECT count(w.kb_id) AS count
           FROM execution w
          WHERE w.kb_id = v.kb_id AND w.plan_id = v.id) AS steps,
    ( SELECT count(w.kb_id) AS count
           FROM execution_version w
          WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome::text = 'running'::text) AS steps_running,
    ( SELECT count(w.kb_id) AS count
           FROM execution_version w
          WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome::text = 'succeeded'::text) AS steps_succeeded,
    ( SELECT count(w.kb_id) AS count
           FROM execution_version w
          WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome::text = 'failed'::text) AS steps_failed,
    ( SELECT count(w.kb_id) AS count
           FROM execution_version w
          WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.outcome::text = 'aborted'::text) AS steps_aborted,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.domain_pddl,
    v.problem_pddl,
    v.kb_id
   FROM plan v
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.revision
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_plan_step (
    knowledge_base character varying(255) COLLATE "C",
    plan_id bigint,
    "position" integer,
    action character varying(255) COLLATE "C",
    arguments text COLLATE "C",
    text text COLLATE "C",
    planned_start double precision,
    planned_duration double precision,
    status text COLLATE "C",
    started bigint,
    started_at timestamp with time zone,
    started_epoch double precision,
    started_by text COLLATE "C",
    ended bigint,
    ended_at timestamp with time zone,
    ended_epoch double precision,
    ended_by text COLLATE "C",
    ended_reason text COLLATE "C",
    duration double precision,
    revisions bigint,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.plan_id,
    v."position",
    a.name AS action,
    rtrim(substr(v.text, length(a.name::text) + 3), ')'::text) AS arguments,
    v.text,
    v.start::double precision AS planned_start,
    v.duration::double precision AS planned_duration,
    w.outcome::text COLLATE "C" AS status,
    b.since AS started,
    s.committed_at AS started_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS started_epoch,
    s.actor AS started_by,
    u.number AS ended,
    u.committed_at AS ended_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS ended_epoch,
    u.actor AS ended_by,
    u.reason AS ended_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    ( SELECT count(x.kb_id) AS count
           FROM revision_execution x
          WHERE x.kb_id = v.kb_id AND x.plan_id = v.plan_id AND x."position" = v."position") AS revisions,
    v.kb_id
   FROM execution v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN action a ON a.kb_id = v.kb_id AND a.id = v.action_id
     LEFT JOIN execution_version w ON w.kb_id = v.kb_id AND w.plan_id = v.plan_id AND w."position" = v."position" AND w.until IS NULL
     LEFT JOIN execution_version b ON b.kb_id = v.kb_id AND b.plan_id = v.plan_id AND b."position" = v."position" AND b.since = (( SELECT max(c.since) AS max
           FROM execution_version c
          WHERE c.kb_id = v.kb_id AND c.plan_id = v.plan_id AND c."position" = v."position" AND c.outcome::text = 'running'::text))
     LEFT JOIN revision s ON s.kb_id = b.kb_id AND s.number = b.since
     LEFT JOIN revision u ON u.kb_id = w.kb_id AND u.number = w.since AND w.outcome::text <> 'running'::text
  WHERE v.plan_id > 0;
CREATE VIEW audit_plan_step_argument (
    knowledge_base character varying(255) COLLATE "C",
    plan_id bigint,
    "position" integer,
    text text COLLATE "C",
    argument integer,
    object character varying(255) COLLATE "C",
    object_id bigint,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.plan_id,
    v."position",
    p.text,
    v.argument,
    o.name AS object,
    v.object_id,
    v.kb_id
   FROM execution_argument v
     LEFT JOIN execution p ON p.kb_id = v.kb_id AND p.plan_id = v.plan_id AND p."position" = v."position"
     LEFT JOIN object o ON o.kb_id = v.kb_id AND o.id = v.object_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
  WHERE v.plan_id > 0;
CREATE VIEW audit_plan_step_status (
    knowledge_base character varying(255) COLLATE "C",
    plan_id bigint,
    "position" integer,
    status text COLLATE "C",
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.plan_id,
    v."position",
    v.outcome::text COLLATE "C" AS status,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM execution_version v
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until
  WHERE v.plan_id > 0;
CREATE VIEW audit_promotion (
    knowledge_base character varying(255) COLLATE "C",
    promotion_id bigint,
    revision bigint,
    revision_at timestamp with time zone,
    revision_epoch double precision,
    origin text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    text text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.id AS promotion_id,
    v.revision,
    r.committed_at AS revision_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS revision_epoch,
    v.origin,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.kb_id
   FROM promotion v
     LEFT JOIN revision r ON r.kb_id = v.kb_id AND r.number = v.revision
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since;
CREATE VIEW audit_revision (
    knowledge_base character varying(255) COLLATE "C",
    revision bigint,
    committed_at timestamp with time zone,
    committed_epoch double precision,
    committed_hour text COLLATE "C",
    observed_at timestamp with time zone,
    observed_epoch double precision,
    delay double precision,
    actor text COLLATE "C",
    reason text COLLATE "C",
    source text COLLATE "C",
    plan_id bigint,
    plan_step integer,
    form integer,
    hash text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    r.number AS revision,
    r.committed_at,
    EXTRACT(epoch FROM r.committed_at)::double precision AS committed_epoch,
    to_char((r.committed_at AT TIME ZONE 'UTC'::text), 'YYYY-MM-DD"T"HH24'::text) COLLATE "C" AS committed_hour,
    r.observed_at,
    EXTRACT(epoch FROM r.observed_at)::double precision AS observed_epoch,
    EXTRACT(epoch FROM r.committed_at - r.observed_at)::double precision AS delay,
    r.actor,
    r.reason,
    r.source::text COLLATE "C" AS source,
    x.plan_id,
    x."position" AS plan_step,
    r.form,
    r.hash,
    r.kb_id
   FROM revision r
     LEFT JOIN knowledge_base k ON k.id = r.kb_id
     LEFT JOIN revision_execution x ON x.kb_id = r.kb_id AND x.number = r.number;
CREATE VIEW audit_statistics (
    knowledge_base character varying(255) COLLATE "C",
    action character varying COLLATE "C",
    arguments text COLLATE "C",
    executions bigint,
    running bigint,
    succeeded bigint,
    failed bigint,
    aborted bigint,
    refused bigint,
    success_rate double precision,
    success_low double precision,
    success_high double precision,
    mean double precision,
    median double precision,
    percentile_95 double precision,
    codes text COLLATE "C",
    kb_id bigint,
    unconfirmed bigint
) AS
 SELECT k.name AS knowledge_base,
    s.action,
    s.arguments,
    s.executions,
    s.running,
    s.succeeded,
    s.failed,
    s.aborted,
    s.refused,
    s.succeeded::double precision / s.decided::double precision AS success_rate,
        CASE s.succeeded
            WHEN 0 THEN s.failed::double precision / s.decided::double precision - 1::double precision
            ELSE ((s.succeeded::numeric + 1.920729410347062)::double precision - 1.959963984540054::double precision * s.spread) / (s.decided::numeric + 3.841458820694124)::double precision
        END AS success_low,
        CASE s.failed
            WHEN 0 THEN s.succeeded::double precision / s.decided::double precision
            ELSE ((s.succeeded::numeric + 1.920729410347062)::double precision + 1.959963984540054::double precision * s.spread) / (s.decided::numeric + 3.841458820694124)::double precision
        END AS success_high,
    s.mean,
    s.median,
    s.percentile_95,
    s.codes,
    s.kb_id,
    s.unconfirmed
   FROM ( SELECT g.knowledge_base,
            g.action,
            g.arguments,
            g.executions,
            g.running,
            g.succeeded,
            g.failed,
            g.aborted,
            g.refused,
            g.mean,
            g.median,
            g.percentile_95,
            g.codes,
            g.unconfirmed,
            g.kb_id,
            NULLIF(g.succeeded + g.failed, 0) AS decided,
            ( WITH RECURSIVE near(step, square, root) AS (
                         SELECT 1 AS "?column?",
                            of.square,
                            of.square
                           FROM ( SELECT g.succeeded::double precision * g.failed::double precision / NULLIF(g.succeeded + g.failed, 0)::double precision + 0.960364705173531::double precision AS square) of
                        UNION ALL
                         SELECT near_1.step + 1,
                            near_1.square,
                            (near_1.root + near_1.square / near_1.root) / 2::double precision
                           FROM near near_1
                          WHERE near_1.step < 40
                        )
                 SELECT near.root
                   FROM near
                  WHERE near.step = 40) AS spread
           FROM ( SELECT p.knowledge_base,
                    p.action,
                    p.arguments,
                    count(*) AS executions,
                    count(
                        CASE p.outcome
                            WHEN 'running'::text THEN 1
                            ELSE NULL::integer
                        END) AS running,
                    count(
                        CASE p.outcome
                            WHEN 'succeeded'::text THEN 1
                            ELSE NULL::integer
                        END) AS succeeded,
                    count(
                        CASE p.outcome
                            WHEN 'failed'::text THEN 1
                            ELSE NULL::integer
                        END) AS failed,
                    count(
                        CASE p.outcome
                            WHEN 'aborted'::text THEN 1
                            ELSE NULL::integer
                        END) AS aborted,
                    count(
                        CASE p.outcome
                            WHEN 'refused'::text THEN 1
                            ELSE NULL::integer
                        END) AS refused,
                    avg(p.duration) AS mean,
                    avg(
                        CASE
                            WHEN p.place = ((p.timed + 1) / 2) OR p.place = ((p.timed + 2) / 2) THEN p.duration
                            ELSE NULL::double precision
                        END) AS median,
                    max(
                        CASE
                            WHEN p.place = ((95 * p.timed + 99) / 100) THEN p.duration
                            ELSE NULL::double precision
                        END) AS percentile_95,
                    string_agg(p.failures, ', '::text) AS codes,
                    COALESCE(sum(p.unconfirmed), 0::numeric)::bigint AS unconfirmed,
                    p.kb_id
                   FROM ( SELECT e.knowledge_base,
                            e.kb_id,
                            e.action,
                            e.arguments,
                            e.outcome,
                            e.code,
                            e.unconfirmed,
                            e.duration,
                            row_number() OVER (PARTITION BY e.kb_id, e.action, e.arguments, (e.duration IS NULL) ORDER BY e.duration) AS place,
                            count(e.duration) OVER (PARTITION BY e.kb_id, e.action, e.arguments) AS timed,
                                CASE row_number() OVER (PARTITION BY e.kb_id, e.action, e.arguments, e.code)
                                    WHEN 1 THEN (e.code || ': '::text) || count(*) OVER (PARTITION BY e.kb_id, e.action, e.arguments, e.code)
                                    ELSE NULL::text
                                END AS failures
                           FROM ( SELECT v.knowledge_base,
                                    v.kb_id,
                                    v.action,
                                    NULL::text COLLATE "C" AS arguments,
                                    v.outcome,
                                    v.code,
                                    u.unconfirmed,
CASE
 WHEN v.outcome = ANY (ARRAY['succeeded'::text, 'failed'::text]) THEN v.duration
 ELSE NULL::double precision
END AS duration
                                   FROM audit_execution v
                                     LEFT JOIN ( SELECT e_1.kb_id,
    e_1.plan_id,
    e_1."position",
    count(*) AS unconfirmed
   FROM audit_effect e_1
  WHERE e_1.until IS NULL AND e_1.confirmed IS NULL
  GROUP BY e_1.kb_id, e_1.plan_id, e_1."position") u ON u.kb_id = v.kb_id AND u.plan_id = v.plan_id AND u."position" = v."position"
                                UNION ALL
                                 SELECT v.knowledge_base,
                                    v.kb_id,
                                    v.action,
                                    COALESCE(v.arguments, ''::text) AS arguments,
                                    v.outcome,
                                    v.code,
                                    u.unconfirmed,
CASE
 WHEN v.outcome = ANY (ARRAY['succeeded'::text, 'failed'::text]) THEN v.duration
 ELSE NULL::double precision
END AS duration
                                   FROM audit_execution v
                                     LEFT JOIN ( SELECT e_1.kb_id,
    e_1.plan_id,
    e_1."position",
    count(*) AS unconfirmed
   FROM audit_effect e_1
  WHERE e_1.until IS NULL AND e_1.confirmed IS NULL
  GROUP BY e_1.kb_id, e_1.plan_id, e_1."position") u ON u.kb_id = v.kb_id AND u.plan_id = v.plan_id AND u."position" = v."position") e) p
                  GROUP BY p.kb_id, p.knowledge_base, p.action, p.arguments) g) s
     LEFT JOIN knowledge_base k ON k.id = s.kb_id;
CREATE VIEW audit_value (
    knowledge_base character varying(255) COLLATE "C",
    function_value_id bigint,
    function character varying(255) COLLATE "C",
    arguments text COLLATE "C",
    fluent text COLLATE "C",
    value text COLLATE "C",
    number double precision,
    text text COLLATE "C",
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    rtrim(substr(f.text, length(d.name::text) + 3), ')'::text) AS arguments,
    f.text AS fluent,
    COALESCE(v.value, o.name::text) AS value,
    v.number,
    v.text,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM function_value_version v
     LEFT JOIN function_value f ON f.kb_id = v.kb_id AND f.id = v.function_value_id
     LEFT JOIN function d ON d.kb_id = v.kb_id AND d.id = v.function_id
     LEFT JOIN object o ON o.kb_id = v.kb_id AND o.id = v.object_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_value_argument (
    knowledge_base character varying(255) COLLATE "C",
    function_value_id bigint,
    function character varying(255) COLLATE "C",
    text text COLLATE "C",
    "position" integer,
    parameter character varying(255) COLLATE "C",
    object character varying(255) COLLATE "C",
    object_id bigint,
    since bigint,
    since_at timestamp with time zone,
    since_epoch double precision,
    since_observed_at timestamp with time zone,
    asserted_by text COLLATE "C",
    asserted_reason text COLLATE "C",
    until bigint,
    until_at timestamp with time zone,
    until_epoch double precision,
    until_observed_at timestamp with time zone,
    retracted_by text COLLATE "C",
    retracted_reason text COLLATE "C",
    duration double precision,
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    v.text,
    a."position",
    ( SELECT m.name
           FROM function_version w
             JOIN function_parameter m ON m.kb_id = w.kb_id AND m.function_id = w.function_id AND m.since = w.since
          WHERE w.kb_id = v.kb_id AND w.function_id = v.function_id AND w.since <= v.since AND (w.until IS NULL OR w.until > v.since) AND m."position" = a."position") AS parameter,
    o.name AS object,
    a.object_id,
    v.since,
    s.committed_at AS since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.until,
    u.committed_at AS until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    EXTRACT(epoch FROM u.committed_at - s.committed_at)::double precision AS duration,
    v.kb_id
   FROM function_value_version v
     JOIN function_value_argument a ON a.kb_id = v.kb_id AND a.function_value_id = v.function_value_id
     LEFT JOIN object o ON o.kb_id = a.kb_id AND o.id = a.object_id
     LEFT JOIN function d ON d.kb_id = v.kb_id AND d.id = v.function_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until;
CREATE VIEW audit_value_valid (
    knowledge_base character varying(255) COLLATE "C",
    function_value_id bigint,
    function character varying(255) COLLATE "C",
    arguments text COLLATE "C",
    fluent text COLLATE "C",
    value text COLLATE "C",
    number double precision,
    valid_from timestamp with time zone,
    valid_from_epoch double precision,
    valid_until timestamp with time zone,
    valid_until_epoch double precision,
    known_since bigint,
    known_since_at timestamp with time zone,
    known_since_epoch double precision,
    known_by text COLLATE "C",
    known_reason text COLLATE "C",
    known_until bigint,
    known_until_at timestamp with time zone,
    known_until_epoch double precision,
    corrected_by text COLLATE "C",
    corrected_reason text COLLATE "C",
    kb_id bigint
) AS
 SELECT k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    rtrim(substr(p.text, length(d.name::text) + 3), ')'::text) AS arguments,
    p.text AS fluent,
    COALESCE(v.value, o.name::text) AS value,
    v.number,
    v.valid_from,
    EXTRACT(epoch FROM v.valid_from)::double precision AS valid_from_epoch,
    v.valid_until,
    EXTRACT(epoch FROM v.valid_until)::double precision AS valid_until_epoch,
    v.known_since,
    s.committed_at AS known_since_at,
    EXTRACT(epoch FROM s.committed_at)::double precision AS known_since_epoch,
    s.actor AS known_by,
    s.reason AS known_reason,
    v.known_until,
    u.committed_at AS known_until_at,
    EXTRACT(epoch FROM u.committed_at)::double precision AS known_until_epoch,
    u.actor AS corrected_by,
    u.reason AS corrected_reason,
    v.kb_id
   FROM ( SELECT w.kb_id,
            w.function_value_id,
            w.function_id,
            w.value,
            w.number,
            w.object_id,
            s_1.committed_at AS valid_from,
            u_1.committed_at AS valid_until,
            w.since AS known_since,
            NULL::bigint AS known_until
           FROM function_value_version w
             JOIN revision s_1 ON s_1.kb_id = w.kb_id AND s_1.number = w.since
             LEFT JOIN revision u_1 ON u_1.kb_id = w.kb_id AND u_1.number = w.until
          WHERE true AND COALESCE(s_1.committed_at < u_1.committed_at, w.until IS NULL) AND NOT (EXISTS ( SELECT 1
                   FROM function_value_saying l
                  WHERE l.kb_id = w.kb_id AND l.function_value_id = w.function_value_id))
        UNION ALL
         SELECT w.kb_id,
            w.function_value_id,
            w.function_id,
            w.value,
            w.number,
            w.object_id,
            u_1.committed_at AS valid_from,
            NULL::timestamp with time zone AS valid_until,
            w.since AS known_since,
            w.until AS known_until
           FROM function_value_version w
             JOIN revision u_1 ON u_1.kb_id = w.kb_id AND u_1.number = w.until
          WHERE true
        UNION ALL
         SELECT w.kb_id,
            w.function_value_id,
            w.function_id,
            w.value,
            w.number,
            w.object_id,
            w.valid_from,
            w.valid_until,
            w.since AS known_since,
            w.known_until
           FROM ( SELECT e.kb_id,
                    e.function_value_id,
                    e.function_id,
                    e.value,
                    e.number,
                    e.object_id,
                    e.since,
                    e.begun,
                    e.ended,
                    e.holds,
                    g.valid_from,
                    g.valid_until,
                    lead(e.since) OVER (PARTITION BY e.kb_id, e.function_value_id, g.valid_from ORDER BY e.since) AS known_until
                   FROM ( SELECT m.kb_id,
                            m.function_value_id,
                            m.moment AS valid_from,
                            lead(m.moment) OVER (PARTITION BY m.kb_id, m.function_value_id ORDER BY m.moment) AS valid_until
                           FROM ( SELECT l.kb_id,
                                    l.function_value_id,
                                    l.valid_from AS moment
                                   FROM function_value_saying l
                                UNION
                                 SELECT l.kb_id,
                                    l.function_value_id,
                                    l.valid_until
                                   FROM function_value_saying l
                                UNION
                                 SELECT n.kb_id,
                                    n.function_value_id,
                                    q.committed_at
                                   FROM function_value_version n
                                     JOIN revision q ON q.kb_id = n.kb_id AND (q.number = n.since OR q.number = n.until)
                                  WHERE (EXISTS ( SELECT 1
   FROM function_value_saying l
  WHERE l.kb_id = n.kb_id AND l.function_value_id = n.function_value_id))) m) g
                     JOIN ( SELECT l.kb_id,
                            l.function_value_id,
                            l.function_id,
                            l.value,
                            l.number,
                            l.object_id,
                            l.since,
                            l.valid_from AS begun,
                            l.valid_until AS ended,
                            l.number IS NOT NULL OR l.object_id IS NOT NULL AS holds
                           FROM function_value_saying l
                        UNION ALL
                         SELECT w_1.kb_id,
                            w_1.function_value_id,
                            w_1.function_id,
                            w_1.value,
                            w_1.number,
                            w_1.object_id,
                            w_1.since,
                            s_1.committed_at,
                            u_1.committed_at,
                            true
                           FROM function_value_version w_1
                             JOIN revision s_1 ON s_1.kb_id = w_1.kb_id AND s_1.number = w_1.since
                             LEFT JOIN revision u_1 ON u_1.kb_id = w_1.kb_id AND u_1.number = w_1.until
                          WHERE true AND (EXISTS ( SELECT 1
                                   FROM function_value_saying l
                                  WHERE l.kb_id = w_1.kb_id AND l.function_value_id = w_1.function_value_id))) e ON e.kb_id = g.kb_id AND e.function_value_id = g.function_value_id AND e.begun <= g.valid_from AND COALESCE(g.valid_from < e.ended, true)) w
          WHERE w.holds) v
     LEFT JOIN function_value p ON p.kb_id = v.kb_id AND p.id = v.function_value_id
     LEFT JOIN function d ON d.kb_id = v.kb_id AND d.id = v.function_id
     LEFT JOIN object o ON o.kb_id = v.kb_id AND o.id = v.object_id
     LEFT JOIN knowledge_base k ON k.id = v.kb_id
     LEFT JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.known_since
     LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.known_until;
