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
CREATE INDEX ix_function_value_version_history ON public.function_value_version USING btree (kb_id, function_id, since, until, function_value_id);
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
CREATE INDEX ix_predicate_version_since ON public.predicate_version USING btree (kb_id, since, predicate_id);
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
    is_goal boolean DEFAULT false NOT NULL,
    CONSTRAINT ck_proposition_version_since_before_until CHECK ((since < until)),
    CONSTRAINT fk_proposition_version_kb_id_predicate_id FOREIGN KEY (kb_id, predicate_id) REFERENCES predicate(kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_proposition_id FOREIGN KEY (kb_id, proposition_id) REFERENCES proposition(kb_id, id),
    CONSTRAINT fk_proposition_version_kb_id_since FOREIGN KEY (kb_id, since) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT fk_proposition_version_kb_id_until FOREIGN KEY (kb_id, until) REFERENCES revision(kb_id, number) DEFERRABLE INITIALLY DEFERRED,
    CONSTRAINT pk_proposition_version PRIMARY KEY (kb_id, proposition_id, since)
);
CREATE INDEX ix_proposition_version_goal ON public.proposition_version USING btree (kb_id, until, since, proposition_id) WHERE is_goal;
CREATE INDEX ix_proposition_version_goal_history ON public.proposition_version USING btree (kb_id, since, until, proposition_id) WHERE is_goal;
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
