-- What version 0001 wrote: two knowledge bases, the first with the whole language and a plan.
-- Frozen, as the migration is. It runs on SQLite and PostgreSQL.

INSERT INTO knowledge_base (id, name) VALUES
    (1, 'tiago'),
    (2, 'Küche 🤖');

INSERT INTO head (kb_id, revision, definition_revision, next_id, hash, committed_at, archived_revision) VALUES
    (1, 9, 4, 29, 'e18985f83607c6204053daa6c16ed913664b8383a40b19228f4b2945d57fc0aa', '2026-05-04T09:40:00.250000Z', 0),
    (2, 1, 1, 3, 'd3e9ee6985711804ac9058bdb7f0aa450e19f93443b0c6b8d8652e2c174dbb4a', '2026-05-04T09:36:00.250000Z', 0);

INSERT INTO revision (kb_id, number, committed_at, actor, reason, source, form, hash, observed_at) VALUES
    (1, 1, '2026-05-04T09:31:00.250000Z', 'operator', NULL, NULL, 1, '30a5f5eb299a41deb0efd3f02a85f9cc25ba5de89442e576c4c2e0d464d2998d', NULL),
    (1, 2, '2026-05-04T09:32:00.250000Z', 'operator', 'Monday''s mission', '{"file":"monday.pddl","size":1e+21}', 1, 'd3f60847362025ad0318644a9e2cbf708c8d8892fb58fcb1f77b39dba9c99103', '2026-05-04T09:31:58.500000Z'),
    (1, 3, '2026-05-04T09:33:00.250000Z', 'executive', '(move rb1 wp1 wp2)', NULL, 1, '47c8bc581a416ceb80db8c8589c06658df7ec1e3e18a225f3b90d2de593e8543', NULL),
    (1, 4, '2026-05-04T09:34:00.250000Z', 'operator', NULL, NULL, 1, '4156ef028d597d209f3cc30ba41e76584a365c5235c2db7c7b11b217bc452c7d', NULL),
    (1, 5, '2026-05-04T09:35:00.250000Z', 'operator', NULL, NULL, 1, 'efef332fb7ebe8c023c1df0e6c01442aa465cc16bd188bfd331144e610f844fa', NULL),
    (1, 6, '2026-05-04T09:37:00.250000Z', 'executive', NULL, NULL, 1, '5caf18ae4d42495ceae5d60aef50062c076f1de45526836de35a9226583e94a2', NULL),
    (1, 7, '2026-05-04T09:38:00.250000Z', 'executive', NULL, NULL, 1, '661c523bb756674745e4f1395b88f9ff11b8514b0330febc333fd5eda1910479', NULL),
    (1, 8, '2026-05-04T09:39:00.250000Z', 'executive', 'arrived', NULL, 1, '7ac56f984468dfd983c3cfc03c501aae1ff0006aea986ba96b1a1f86f0ce4ddc', '2026-05-04T09:38:59.750000Z'),
    (1, 9, '2026-05-04T09:40:00.250000Z', 'executive', NULL, NULL, 1, 'e18985f83607c6204053daa6c16ed913664b8383a40b19228f4b2945d57fc0aa', NULL),
    (2, 1, '2026-05-04T09:36:00.250000Z', NULL, NULL, NULL, 1, 'd3e9ee6985711804ac9058bdb7f0aa450e19f93443b0c6b8d8652e2c174dbb4a', NULL);

INSERT INTO type (kb_id, id, name, key) VALUES
    (1, 1, 'place', 'place'),
    (1, 2, 'robot', 'robot'),
    (1, 3, 'dock', 'dock'),
    (2, 1, 'robot', 'robot');

INSERT INTO type_version (kb_id, type_id, since, until, parent_id, text) VALUES
    (1, 1, 1, NULL, NULL, 'place'),
    (1, 2, 1, NULL, NULL, 'robot'),
    (1, 3, 1, NULL, 1, 'dock - place'),
    (2, 1, 1, NULL, NULL, 'robot');

INSERT INTO object (kb_id, id, name, key) VALUES
    (1, 4, 'Home', 'home'),
    (1, 15, 'rb1', 'rb1'),
    (1, 16, 'wp1', 'wp1'),
    (1, 17, 'wp2', 'wp2'),
    (2, 2, 'rb1', 'rb1');

INSERT INTO object_version (kb_id, object_id, since, until, type_id, text, is_constant) VALUES
    (1, 4, 1, NULL, 3, '(:constants Home - dock)', true),
    (1, 15, 2, NULL, 2, 'rb1 - robot', false),
    (1, 16, 2, NULL, 1, 'wp1 - place', false),
    (1, 17, 2, NULL, 1, 'wp2 - place', false),
    (2, 2, 1, NULL, 1, 'rb1 - robot', false);

INSERT INTO predicate (kb_id, id, name, key) VALUES
    (1, 5, 'at', 'at'),
    (1, 6, 'idle', 'idle'),
    (1, 7, 'busy', 'busy');

INSERT INTO predicate_version (kb_id, predicate_id, since, until, text) VALUES
    (1, 5, 1, NULL, '(at ?r - robot ?p - place)'),
    (1, 6, 1, NULL, '(idle)'),
    (1, 7, 1, NULL, '(busy)');

INSERT INTO predicate_parameter (kb_id, predicate_id, since, position, name) VALUES
    (1, 5, 1, 0, 'r'),
    (1, 5, 1, 1, 'p');

INSERT INTO predicate_parameter_type (kb_id, predicate_id, since, position, alternative, type_id) VALUES
    (1, 5, 1, 0, 0, 2),
    (1, 5, 1, 1, 0, 1);

INSERT INTO proposition (kb_id, id, predicate_id, is_goal, arguments, text) VALUES
    (1, 18, 5, false, '15 16', '(at rb1 wp1)'),
    (1, 19, 5, true, '15 17', '(at rb1 wp2)'),
    (1, 27, 5, false, '15 17', '(at rb1 wp2)');

INSERT INTO proposition_argument (kb_id, proposition_id, position, object_id) VALUES
    (1, 18, 0, 15),
    (1, 18, 1, 16),
    (1, 19, 0, 15),
    (1, 19, 1, 17),
    (1, 27, 0, 15),
    (1, 27, 1, 17);

INSERT INTO proposition_version (kb_id, proposition_id, since, until, predicate_id, is_goal, fork) VALUES
    (1, 18, 2, 3, 5, false, 2),
    (1, 19, 2, 5, 5, true, 4),
    (1, 27, 3, 5, 5, false, 4),
    (1, 27, 8, NULL, 5, false, 0);

INSERT INTO function (kb_id, id, name, key) VALUES
    (1, 8, 'battery', 'battery'),
    (1, 9, 'total-cost', 'total-cost');

INSERT INTO function_version (kb_id, function_id, since, until, text) VALUES
    (1, 8, 1, NULL, '(battery ?r - robot)'),
    (1, 9, 1, NULL, '(total-cost)');

INSERT INTO function_parameter (kb_id, function_id, since, position, name) VALUES
    (1, 8, 1, 0, 'r');

INSERT INTO function_parameter_type (kb_id, function_id, since, position, alternative, type_id) VALUES
    (1, 8, 1, 0, 0, 2);

INSERT INTO function_value (kb_id, id, function_id, arguments, text) VALUES
    (1, 20, 8, '15', '(battery rb1)'),
    (1, 21, 9, '', '(total-cost)');

INSERT INTO function_value_argument (kb_id, function_value_id, position, object_id) VALUES
    (1, 20, 0, 15);

INSERT INTO function_value_version (kb_id, function_value_id, since, until, function_id, value, number, object_id, text, fork) VALUES
    (1, 20, 2, 3, 8, '80.50', 80.5, NULL, '(= (battery rb1) 80.50)', 2),
    (1, 20, 3, NULL, 8, '79.5', 79.5, NULL, '(= (battery rb1) 79.5)', 0),
    (1, 21, 2, NULL, 9, '0', 0.0, NULL, '(= (total-cost) 0)', 0);

INSERT INTO action (kb_id, id, name, key) VALUES
    (1, 11, 'move', 'move'),
    (1, 12, 'rest', 'rest'),
    (1, 13, 'charge', 'charge');

INSERT INTO action_version (kb_id, action_id, since, until, text, kind) VALUES
    (1, 11, 1, NULL, '(:durative-action move
	:parameters ( ?r - robot ?from - place ?to - place)
	:duration (= ?duration 5)
	:condition (and
		(at start (at ?r ?from))
		(over all (> (battery ?r) 0.5))
	)
	:effect (and
		(at start (not (at ?r ?from)))
		(at end (at ?r ?to))
		(at end (decrease (battery ?r) 1))
	)
)', 'durative-action'),
    (1, 12, 1, NULL, '(:action rest
	:parameters ( ?r - robot)
	:precondition (and
		(or (at ?r Home) (busy))
	)
	:effect (and
		(idle)
	)
)', 'action'),
    (1, 13, 1, NULL, '(:process charge
	:parameters ( ?r - robot)
	:precondition (and
		(at ?r Home)
	)
	:effect (and
		(increase (battery ?r) (* #t 0.5))
	)
)', 'process');

INSERT INTO action_parameter (kb_id, action_id, since, position, name) VALUES
    (1, 11, 1, 0, 'r'),
    (1, 11, 1, 1, 'from'),
    (1, 11, 1, 2, 'to'),
    (1, 12, 1, 0, 'r'),
    (1, 13, 1, 0, 'r');

INSERT INTO action_parameter_type (kb_id, action_id, since, position, alternative, type_id) VALUES
    (1, 11, 1, 0, 0, 2),
    (1, 11, 1, 1, 0, 1),
    (1, 11, 1, 2, 0, 1),
    (1, 12, 1, 0, 0, 2),
    (1, 13, 1, 0, 0, 2);

INSERT INTO action_node (kb_id, action_id, since, section, position, parent, operator, predicate_id, function_id, value) VALUES
    (1, 11, 1, 'condition', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 11, 1, 'condition', 1, 0, 'at start', NULL, NULL, NULL),
    (1, 11, 1, 'condition', 2, 1, 'predicate', 5, NULL, NULL),
    (1, 11, 1, 'condition', 3, 0, 'over all', NULL, NULL, NULL),
    (1, 11, 1, 'condition', 4, 3, '>', NULL, NULL, NULL),
    (1, 11, 1, 'condition', 5, 4, 'function', NULL, 8, NULL),
    (1, 11, 1, 'condition', 6, 4, 'number', NULL, NULL, '0.5'),
    (1, 11, 1, 'duration', 0, NULL, '=', NULL, NULL, NULL),
    (1, 11, 1, 'duration', 1, 0, 'variable', NULL, NULL, '?duration'),
    (1, 11, 1, 'duration', 2, 0, 'number', NULL, NULL, '5'),
    (1, 11, 1, 'effect', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 11, 1, 'effect', 1, 0, 'at start', NULL, NULL, NULL),
    (1, 11, 1, 'effect', 2, 1, 'not', NULL, NULL, NULL),
    (1, 11, 1, 'effect', 3, 2, 'predicate', 5, NULL, NULL),
    (1, 11, 1, 'effect', 4, 0, 'at end', NULL, NULL, NULL),
    (1, 11, 1, 'effect', 5, 4, 'predicate', 5, NULL, NULL),
    (1, 11, 1, 'effect', 6, 0, 'at end', NULL, NULL, NULL),
    (1, 11, 1, 'effect', 7, 6, 'decrease', NULL, NULL, NULL),
    (1, 11, 1, 'effect', 8, 7, 'function', NULL, 8, NULL),
    (1, 11, 1, 'effect', 9, 7, 'number', NULL, NULL, '1'),
    (1, 12, 1, 'condition', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 12, 1, 'condition', 1, 0, 'or', NULL, NULL, NULL),
    (1, 12, 1, 'condition', 2, 1, 'predicate', 5, NULL, NULL),
    (1, 12, 1, 'condition', 3, 1, 'predicate', 7, NULL, NULL),
    (1, 12, 1, 'effect', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 12, 1, 'effect', 1, 0, 'predicate', 6, NULL, NULL),
    (1, 13, 1, 'condition', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 13, 1, 'condition', 1, 0, 'predicate', 5, NULL, NULL),
    (1, 13, 1, 'effect', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 13, 1, 'effect', 1, 0, 'increase', NULL, NULL, NULL),
    (1, 13, 1, 'effect', 2, 1, 'function', NULL, 8, NULL),
    (1, 13, 1, 'effect', 3, 1, '*', NULL, NULL, NULL),
    (1, 13, 1, 'effect', 4, 3, '#t', NULL, NULL, NULL),
    (1, 13, 1, 'effect', 5, 3, 'number', NULL, NULL, '0.5');

INSERT INTO action_term (kb_id, action_id, since, section, position, term, parameter, object_id, quantifier, variable, child) VALUES
    (1, 11, 1, 'condition', 2, 0, 0, NULL, NULL, NULL, NULL),
    (1, 11, 1, 'condition', 2, 1, 1, NULL, NULL, NULL, NULL),
    (1, 11, 1, 'condition', 5, 0, 0, NULL, NULL, NULL, NULL),
    (1, 11, 1, 'effect', 3, 0, 0, NULL, NULL, NULL, NULL),
    (1, 11, 1, 'effect', 3, 1, 1, NULL, NULL, NULL, NULL),
    (1, 11, 1, 'effect', 5, 0, 0, NULL, NULL, NULL, NULL),
    (1, 11, 1, 'effect', 5, 1, 2, NULL, NULL, NULL, NULL),
    (1, 11, 1, 'effect', 8, 0, 0, NULL, NULL, NULL, NULL),
    (1, 12, 1, 'condition', 2, 0, 0, NULL, NULL, NULL, NULL),
    (1, 12, 1, 'condition', 2, 1, NULL, 4, NULL, NULL, NULL),
    (1, 13, 1, 'condition', 1, 0, 0, NULL, NULL, NULL, NULL),
    (1, 13, 1, 'condition', 1, 1, NULL, 4, NULL, NULL, NULL),
    (1, 13, 1, 'effect', 2, 0, 0, NULL, NULL, NULL, NULL);

INSERT INTO formula (kb_id, id, name, key) VALUES
    (1, 10, '3088ba1dacd8ea97dc9070728e2bc224e4bd7ef53557039de0e3e76286973a0c', '3088ba1dacd8ea97dc9070728e2bc224e4bd7ef53557039de0e3e76286973a0c'),
    (1, 22, '7eff5c54dd6b2703a83960a1880219a3e29cc52381779572a97b7c51bcbdde66', '7eff5c54dd6b2703a83960a1880219a3e29cc52381779572a97b7c51bcbdde66'),
    (1, 23, 'c8e4f9d2fd6802ea45b8fd5b2f7fac94d0cfd0252244c4f2266a6542f8e5959a', 'c8e4f9d2fd6802ea45b8fd5b2f7fac94d0cfd0252244c4f2266a6542f8e5959a'),
    (1, 24, '1c368e59eb4b2f6e8a10f6f4aa8686f634ac6a9efd0993b4925265ddfca37c11', '1c368e59eb4b2f6e8a10f6f4aa8686f634ac6a9efd0993b4925265ddfca37c11'),
    (1, 25, '7efa376d799ef38639b6529e7787a121593fa80b63e2d47b4f9295b983dd7de0', '7efa376d799ef38639b6529e7787a121593fa80b63e2d47b4f9295b983dd7de0');

INSERT INTO formula_version (kb_id, formula_id, since, until, section, text) VALUES
    (1, 10, 1, NULL, 'derived', '(:derived (busy) (not (idle)))'),
    (1, 22, 2, NULL, 'goal', '(or (idle) (at rb1 Home))'),
    (1, 23, 2, NULL, 'timed', '(at 60 (idle))'),
    (1, 24, 2, NULL, 'constraint', '(always (> (battery rb1) 0))'),
    (1, 25, 2, 4, 'metric', '(:metric minimize (total-cost))');

INSERT INTO formula_node (kb_id, formula_id, since, section, position, parent, operator, predicate_id, function_id, value) VALUES
    (1, 10, 1, 'derived', 0, NULL, 'derived', NULL, NULL, NULL),
    (1, 10, 1, 'derived', 1, 0, 'predicate', 7, NULL, NULL),
    (1, 10, 1, 'derived', 2, 0, 'not', NULL, NULL, NULL),
    (1, 10, 1, 'derived', 3, 2, 'predicate', 6, NULL, NULL),
    (1, 22, 2, 'goal', 0, NULL, 'or', NULL, NULL, NULL),
    (1, 22, 2, 'goal', 1, 0, 'predicate', 6, NULL, NULL),
    (1, 22, 2, 'goal', 2, 0, 'predicate', 5, NULL, NULL),
    (1, 23, 2, 'timed', 0, NULL, 'at', NULL, NULL, '60'),
    (1, 23, 2, 'timed', 1, 0, 'predicate', 6, NULL, NULL),
    (1, 24, 2, 'constraint', 0, NULL, 'always', NULL, NULL, NULL),
    (1, 24, 2, 'constraint', 1, 0, '>', NULL, NULL, NULL),
    (1, 24, 2, 'constraint', 2, 1, 'function', NULL, 8, NULL),
    (1, 24, 2, 'constraint', 3, 1, 'number', NULL, NULL, '0'),
    (1, 25, 2, 'metric', 0, NULL, 'minimize', NULL, NULL, NULL),
    (1, 25, 2, 'metric', 1, 0, 'function', NULL, 9, NULL);

INSERT INTO formula_term (kb_id, formula_id, since, section, position, term, parameter, object_id, quantifier, variable, child) VALUES
    (1, 22, 2, 'goal', 2, 0, NULL, 15, NULL, NULL, NULL),
    (1, 22, 2, 'goal', 2, 1, NULL, 4, NULL, NULL, NULL),
    (1, 24, 2, 'constraint', 2, 0, NULL, 15, NULL, NULL, NULL);

INSERT INTO document (kb_id, id, name, key) VALUES
    (1, 14, 'domain', 'domain'),
    (1, 26, 'problem', 'problem');

INSERT INTO document_version (kb_id, document_id, since, until, title, domain, text) VALUES
    (1, 14, 1, NULL, 'depot', NULL, '(define (domain depot) (:action move rest charge) (:constant home) (:derived 3088ba1dacd8ea97dc9070728e2bc224e4bd7ef53557039de0e3e76286973a0c) (:function battery total-cost) (:predicate at idle busy) (:requirement :typing :durative-actions :numeric-fluents :derived-predicates :constraints :time :timed-initial-literals :preferences :disjunctive-preconditions :equality :negative-preconditions) (:type place robot dock))'),
    (1, 26, 2, NULL, 'monday', 'depot', '(define (problem monday) (:domain depot) (:constraint 1c368e59eb4b2f6e8a10f6f4aa8686f634ac6a9efd0993b4925265ddfca37c11) (:goal (at rb1 wp2) 7eff5c54dd6b2703a83960a1880219a3e29cc52381779572a97b7c51bcbdde66) (:metric 7efa376d799ef38639b6529e7787a121593fa80b63e2d47b4f9295b983dd7de0) (:object rb1 wp1 wp2) (:timed c8e4f9d2fd6802ea45b8fd5b2f7fac94d0cfd0252244c4f2266a6542f8e5959a))');

INSERT INTO document_item (kb_id, document_id, since, section, position, name) VALUES
    (1, 14, 1, 'action', 0, 'move'),
    (1, 14, 1, 'action', 1, 'rest'),
    (1, 14, 1, 'action', 2, 'charge'),
    (1, 14, 1, 'constant', 0, 'home'),
    (1, 14, 1, 'derived', 0, '3088ba1dacd8ea97dc9070728e2bc224e4bd7ef53557039de0e3e76286973a0c'),
    (1, 14, 1, 'function', 0, 'battery'),
    (1, 14, 1, 'function', 1, 'total-cost'),
    (1, 14, 1, 'predicate', 0, 'at'),
    (1, 14, 1, 'predicate', 1, 'idle'),
    (1, 14, 1, 'predicate', 2, 'busy'),
    (1, 14, 1, 'requirement', 0, ':typing'),
    (1, 14, 1, 'requirement', 1, ':durative-actions'),
    (1, 14, 1, 'requirement', 2, ':numeric-fluents'),
    (1, 14, 1, 'requirement', 3, ':derived-predicates'),
    (1, 14, 1, 'requirement', 4, ':constraints'),
    (1, 14, 1, 'requirement', 5, ':time'),
    (1, 14, 1, 'requirement', 6, ':timed-initial-literals'),
    (1, 14, 1, 'requirement', 7, ':preferences'),
    (1, 14, 1, 'requirement', 8, ':disjunctive-preconditions'),
    (1, 14, 1, 'requirement', 9, ':equality'),
    (1, 14, 1, 'requirement', 10, ':negative-preconditions'),
    (1, 14, 1, 'type', 0, 'place'),
    (1, 14, 1, 'type', 1, 'robot'),
    (1, 14, 1, 'type', 2, 'dock'),
    (1, 26, 2, 'constraint', 0, '1c368e59eb4b2f6e8a10f6f4aa8686f634ac6a9efd0993b4925265ddfca37c11'),
    (1, 26, 2, 'goal', 0, '(at rb1 wp2)'),
    (1, 26, 2, 'goal', 1, '7eff5c54dd6b2703a83960a1880219a3e29cc52381779572a97b7c51bcbdde66'),
    (1, 26, 2, 'metric', 0, '7efa376d799ef38639b6529e7787a121593fa80b63e2d47b4f9295b983dd7de0'),
    (1, 26, 2, 'object', 0, 'rb1'),
    (1, 26, 2, 'object', 1, 'wp1'),
    (1, 26, 2, 'object', 2, 'wp2'),
    (1, 26, 2, 'timed', 0, 'c8e4f9d2fd6802ea45b8fd5b2f7fac94d0cfd0252244c4f2266a6542f8e5959a');

INSERT INTO plan (kb_id, id, since, revision, problem_hash, planner, planner_version, objective, value, status, domain_pddl, problem_pddl, text) VALUES
    (1, 28, 6, 2, '4d983d0704991c3121c624a5799f26fb52bbd375995964f268a072086f57ec66', 'by hand', NULL, 'minimize (total-cost)', NULL, NULL, NULL, NULL, '(:plan 28 :revision 2 :problem-hash "4d983d0704991c3121c624a5799f26fb52bbd375995964f268a072086f57ec66" :planner "by hand" :planner-version null :objective "minimize (total-cost)" :value null :status null :domain-pddl null :problem-pddl null :steps ((null (move rb1 wp1 wp2) null) (null (rest rb1) null)))');

INSERT INTO plan_step (kb_id, plan_id, position, start, duration, action_id, text) VALUES
    (1, 28, 0, NULL, NULL, 11, '(move rb1 wp1 wp2)'),
    (1, 28, 1, NULL, NULL, 12, '(rest rb1)');

INSERT INTO plan_step_argument (kb_id, plan_id, position, argument, object_id) VALUES
    (1, 28, 0, 0, 15),
    (1, 28, 0, 1, 16),
    (1, 28, 0, 2, 17),
    (1, 28, 1, 0, 15);

INSERT INTO plan_step_version (kb_id, plan_id, position, since, until, status, text) VALUES
    (1, 28, 0, 7, 9, 'started', '(:plan 28 :step 0 started)'),
    (1, 28, 0, 9, NULL, 'succeeded', '(:plan 28 :step 0 succeeded)');

INSERT INTO revision_plan_step (kb_id, number, plan_id, position) VALUES
    (1, 8, 28, 0);
