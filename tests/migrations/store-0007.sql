-- What version 0007 wrote: plans with steps in every status, of which a part was archived.
-- Frozen, as the migration is. It runs on SQLite and PostgreSQL.

INSERT INTO knowledge_base (id, name) VALUES
    (1, 'rounds');
INSERT INTO action (kb_id, id, name, key) VALUES
    (1, 5, 'move', 'move'),
    (1, 6, 'scan', 'scan');
INSERT INTO document (kb_id, id, name, key) VALUES
    (1, 7, 'domain', 'domain'),
    (1, 15, 'problem', 'problem');
INSERT INTO head (kb_id, revision, definition_revision, next_id, hash, committed_at, archived_revision, origin, origin_revision, origin_committed_at, heard_at) VALUES
    (1, 16, 2, 20, '70251fda3caa35c36090c6cdb78b0f6e8af6a00cad0b1bb49fdef4f30f496ebb', '2026-11-24T00:24:41.018902Z', 7, NULL, NULL, NULL, NULL);
INSERT INTO object (kb_id, id, name, key) VALUES
    (1, 8, 'rb1', 'rb1'),
    (1, 9, 'rb2', 'rb2'),
    (1, 10, 'hall', 'hall'),
    (1, 11, 'lab', 'lab');
INSERT INTO predicate (kb_id, id, name, key) VALUES
    (1, 3, 'at', 'at'),
    (1, 4, 'busy', 'busy');
INSERT INTO revision (kb_id, number, committed_at, actor, reason, source, form, hash, observed_at) VALUES
    (1, 1, '2026-11-24T00:24:40.337564Z', 'executive', NULL, NULL, 1, '5fea0c6b2a2562a4db6625950c43439b009e4b9a7221e0d300fc3fbd6ebe52d3', NULL),
    (1, 2, '2026-11-24T00:24:40.391996Z', 'executive', NULL, NULL, 1, 'a49a85cfeaa4f7f29cd06ad8d617df61b91dc9bc8ff744937349fedbfca1399e', NULL),
    (1, 3, '2026-11-24T00:24:40.416708Z', 'executive', NULL, NULL, 1, '2757867ddf619847c397476e190dd478f23460bb2f547d5cef7c5262afbfe6b2', NULL),
    (1, 4, '2026-11-24T00:24:40.713455Z', 'executive', 'applied (move rb1 hall lab)', NULL, 1, 'e2aa3735fc0d22d6d3fee8050f692e2b7e7a45353a08ce0dc01a7390ef4ae096', NULL),
    (1, 5, '2026-11-24T00:24:40.721170Z', 'executive', 'started (scan rb1 lab)', NULL, 1, '0f9e3dd3ed9b082e5bd8ce48fdc76a688c122726d2d5123dbb0197c111217b9c', NULL),
    (1, 6, '2026-11-24T00:24:40.730593Z', 'executive', 'ended (scan rb1 lab)', NULL, 1, 'd51cc2a3649370548df7bcd69087d915d32b32d9c498fc0223d0a05d4292dd45', NULL),
    (1, 7, '2026-11-24T00:24:40.737444Z', 'executive', 'a visitor', NULL, 1, 'eeee557b80c2c9895614ef0b0ff88a4d7d2ee92a87d3fa9b208cda882ea35638', NULL),
    (1, 8, '2026-11-24T00:24:40.738714Z', 'executive', 'ended (scan rb2 lab)', NULL, 1, '04b9b6a6ea7cd052a35e3927f2df388548bac61e809f5921a7f0bc36066ef0db', NULL),
    (1, 9, '2026-11-24T00:24:40.983874Z', 'executive', NULL, NULL, 1, 'b25fba7b8cc76cbb28da4b7f98e7b4907093ba0beac784aaa979d5e0bb4b102c', NULL),
    (1, 10, '2026-11-24T00:24:41.011211Z', 'executive', NULL, NULL, 1, 'deb67e96ce433315b26f28aab9474186930cf61e38199fbc700a730156585f85', NULL),
    (1, 11, '2026-11-24T00:24:41.016370Z', 'executive', 'applied (move rb1 lab hall)', NULL, 1, '8f640f97c000e6629e79e9c455f0500029c28686293b1783f5e20bb87ffc9416', NULL),
    (1, 12, '2026-11-24T00:24:41.016975Z', 'executive', NULL, NULL, 1, '3c65986f339f3fbc70edeaf7313aa68cfe543c627ebcd38636299a8ea88cbc95', NULL),
    (1, 13, '2026-11-24T00:24:41.017317Z', 'executive', 'the door is shut', NULL, 1, '1297645aea5a44b43d28429850779e061f3eb290a8727fe5098b381384721bf6', NULL),
    (1, 14, '2026-11-24T00:24:41.017576Z', 'executive', NULL, NULL, 1, 'fd0c3e1af2e2703a0b9fad6a501283bcb7fded0130d04c77ff799a37dacead89', NULL),
    (1, 15, '2026-11-24T00:24:41.017737Z', 'executive', NULL, NULL, 1, 'a74a214ed77fa87760d8304faf5c6c11f49306be840eb711dbeb4ae0b947bd2f', NULL),
    (1, 16, '2026-11-24T00:24:41.018902Z', 'executive', 'a second look', NULL, 1, '70251fda3caa35c36090c6cdb78b0f6e8af6a00cad0b1bb49fdef4f30f496ebb', NULL);
INSERT INTO type (kb_id, id, name, key) VALUES
    (1, 1, 'robot', 'robot'),
    (1, 2, 'place', 'place');
INSERT INTO action_version (kb_id, action_id, since, until, text, kind) VALUES
    (1, 5, 1, NULL, '(:action move
	:parameters ( ?r - robot ?a - place ?b - place)
	:precondition (and
		(at ?r ?a)
	)
	:effect (and
		(not (at ?r ?a))
		(at ?r ?b)
	)
)', 'action'),
    (1, 6, 1, NULL, '(:durative-action scan
	:parameters ( ?r - robot ?p - place)
	:duration (= ?duration 5)
	:condition (and
		(at start (at ?r ?p))
	)
	:effect (and
		(at start (busy ?r))
		(at end (not (busy ?r)))
	)
)', 'durative-action');
INSERT INTO archive (kb_id, id, since, revision, target, versions, rest, text) VALUES
    (1, 19, 9, 7, 'sqlite:///archive.db', 3, 'd59c6ecbb753df6bd5b09ecb17feae303053f63dd50398131f08655b2beeb896', '(archive 19 :upto 7 :to "sqlite:///archive.db" :versions 3 :rest "d59c6ecbb753df6bd5b09ecb17feae303053f63dd50398131f08655b2beeb896")');
INSERT INTO document_version (kb_id, document_id, since, until, title, domain, text) VALUES
    (1, 7, 1, NULL, 'rounds', NULL, '(define (domain rounds) (:action move scan) (:predicate at busy) (:requirement :typing :durative-actions) (:type robot place))'),
    (1, 15, 2, NULL, 'night', 'rounds', '(define (problem night) (:domain rounds) (:goal (at rb1 lab)) (:object rb1 rb2 hall lab))');
INSERT INTO object_version (kb_id, object_id, since, until, type_id, text, is_constant) VALUES
    (1, 8, 2, NULL, 1, 'rb1 - robot', FALSE),
    (1, 9, 2, NULL, 1, 'rb2 - robot', FALSE),
    (1, 10, 2, NULL, 2, 'hall - place', FALSE),
    (1, 11, 2, NULL, 2, 'lab - place', FALSE);
INSERT INTO plan (kb_id, id, since, revision, problem_hash, planner, planner_version, objective, value, status, domain_pddl, problem_pddl, text) VALUES
    (1, 1, 3, 2, '8a27cd3cf861005c7d27f89cc0bb6b5f0ebffc09bcf8f81d48625ac6005ebe7f', 'by hand', NULL, NULL, NULL, 'solved_satisficing', NULL, NULL, '(:plan 1 :revision 2 :problem-hash "8a27cd3cf861005c7d27f89cc0bb6b5f0ebffc09bcf8f81d48625ac6005ebe7f" :planner "by hand" :planner-version null :objective null :value null :status "solved_satisficing" :domain-pddl null :problem-pddl null :steps ((0 (move rb1 hall lab) null) (1.5 (scan rb1 lab) 5)))'),
    (1, 2, 7, 6, 'e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855', NULL, NULL, NULL, NULL, 'executed', '', '', '(:plan 2 :revision 6 :problem-hash "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" :planner null :planner-version null :objective null :value null :status "executed" :domain-pddl "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" :problem-pddl "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" :steps ((null (scan rb2 lab) 5)))'),
    (1, 3, 10, 9, 'fd06a1b3d86b3a558666f41ac3b41fc90e8d5fc7a7492541cc9d70206946a4de', 'by hand', NULL, NULL, NULL, 'solved_satisficing', NULL, NULL, '(:plan 3 :revision 9 :problem-hash "fd06a1b3d86b3a558666f41ac3b41fc90e8d5fc7a7492541cc9d70206946a4de" :planner "by hand" :planner-version null :objective null :value null :status "solved_satisficing" :domain-pddl null :problem-pddl null :steps ((null (move rb1 lab hall) null) (null (move rb1 hall lab) null) (null (scan rb1 lab) null) (null (move rb2 lab hall) null) (null (move rb2 hall lab) null)))'),
    (1, 4, 16, 15, 'e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855', NULL, NULL, NULL, NULL, 'executed', '', '', '(:plan 4 :revision 15 :problem-hash "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" :planner null :planner-version null :objective null :value null :status "executed" :domain-pddl "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" :problem-pddl "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" :steps ((null (scan rb2 lab) 5)))');
INSERT INTO predicate_version (kb_id, predicate_id, since, until, text) VALUES
    (1, 3, 1, NULL, '(at ?r - robot ?p - place)'),
    (1, 4, 1, NULL, '(busy ?r - robot)');
INSERT INTO proposition (kb_id, id, predicate_id, is_goal, arguments, text) VALUES
    (1, 12, 3, FALSE, '8 10', '(at rb1 hall)'),
    (1, 13, 3, FALSE, '9 11', '(at rb2 lab)'),
    (1, 14, 3, TRUE, '8 11', '(at rb1 lab)'),
    (1, 16, 3, FALSE, '8 11', '(at rb1 lab)'),
    (1, 17, 4, FALSE, '8', '(busy rb1)'),
    (1, 18, 4, FALSE, '9', '(busy rb2)');
INSERT INTO type_version (kb_id, type_id, since, until, parent_id, text) VALUES
    (1, 1, 1, NULL, NULL, 'robot'),
    (1, 2, 1, NULL, NULL, 'place');
INSERT INTO action_node (kb_id, action_id, since, section, position, parent, operator, predicate_id, function_id, value) VALUES
    (1, 5, 1, 'condition', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 5, 1, 'condition', 1, 0, 'predicate', 3, NULL, NULL),
    (1, 5, 1, 'effect', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 5, 1, 'effect', 1, 0, 'not', NULL, NULL, NULL),
    (1, 5, 1, 'effect', 2, 1, 'predicate', 3, NULL, NULL),
    (1, 5, 1, 'effect', 3, 0, 'predicate', 3, NULL, NULL),
    (1, 6, 1, 'condition', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 6, 1, 'condition', 1, 0, 'at start', NULL, NULL, NULL),
    (1, 6, 1, 'condition', 2, 1, 'predicate', 3, NULL, NULL),
    (1, 6, 1, 'duration', 0, NULL, '=', NULL, NULL, NULL),
    (1, 6, 1, 'duration', 1, 0, 'variable', NULL, NULL, '?duration'),
    (1, 6, 1, 'duration', 2, 0, 'number', NULL, NULL, '5'),
    (1, 6, 1, 'effect', 0, NULL, 'and', NULL, NULL, NULL),
    (1, 6, 1, 'effect', 1, 0, 'at start', NULL, NULL, NULL),
    (1, 6, 1, 'effect', 2, 1, 'predicate', 4, NULL, NULL),
    (1, 6, 1, 'effect', 3, 0, 'at end', NULL, NULL, NULL),
    (1, 6, 1, 'effect', 4, 3, 'not', NULL, NULL, NULL),
    (1, 6, 1, 'effect', 5, 4, 'predicate', 4, NULL, NULL);
INSERT INTO action_parameter (kb_id, action_id, since, position, name) VALUES
    (1, 5, 1, 0, 'r'),
    (1, 5, 1, 1, 'a'),
    (1, 5, 1, 2, 'b'),
    (1, 6, 1, 0, 'r'),
    (1, 6, 1, 1, 'p');
INSERT INTO document_item (kb_id, document_id, since, section, position, name) VALUES
    (1, 7, 1, 'action', 0, 'move'),
    (1, 7, 1, 'action', 1, 'scan'),
    (1, 7, 1, 'predicate', 0, 'at'),
    (1, 7, 1, 'predicate', 1, 'busy'),
    (1, 7, 1, 'requirement', 0, ':typing'),
    (1, 7, 1, 'requirement', 1, ':durative-actions'),
    (1, 7, 1, 'type', 0, 'robot'),
    (1, 7, 1, 'type', 1, 'place'),
    (1, 15, 2, 'goal', 0, '(at rb1 lab)'),
    (1, 15, 2, 'object', 0, 'rb1'),
    (1, 15, 2, 'object', 1, 'rb2'),
    (1, 15, 2, 'object', 2, 'hall'),
    (1, 15, 2, 'object', 3, 'lab');
INSERT INTO plan_step (kb_id, plan_id, position, start, duration, action_id, text) VALUES
    (1, 1, 0, '0', NULL, 5, '(move rb1 hall lab)'),
    (1, 1, 1, '1.5', '5', 6, '(scan rb1 lab)'),
    (1, 2, 0, NULL, '5', 6, '(scan rb2 lab)'),
    (1, 3, 0, NULL, NULL, 5, '(move rb1 lab hall)'),
    (1, 3, 1, NULL, NULL, 5, '(move rb1 hall lab)'),
    (1, 3, 2, NULL, NULL, 6, '(scan rb1 lab)'),
    (1, 3, 3, NULL, NULL, 5, '(move rb2 lab hall)'),
    (1, 3, 4, NULL, NULL, 5, '(move rb2 hall lab)'),
    (1, 4, 0, NULL, '5', 6, '(scan rb2 lab)');
INSERT INTO predicate_parameter (kb_id, predicate_id, since, position, name) VALUES
    (1, 3, 1, 0, 'r'),
    (1, 3, 1, 1, 'p'),
    (1, 4, 1, 0, 'r');
INSERT INTO proposition_argument (kb_id, proposition_id, position, object_id) VALUES
    (1, 12, 0, 8),
    (1, 12, 1, 10),
    (1, 13, 0, 9),
    (1, 13, 1, 11),
    (1, 14, 0, 8),
    (1, 14, 1, 11),
    (1, 16, 0, 8),
    (1, 16, 1, 11),
    (1, 17, 0, 8),
    (1, 18, 0, 9);
INSERT INTO proposition_version (kb_id, proposition_id, since, until, predicate_id, is_goal, fork, first_object_id, second_object_id) VALUES
    (1, 12, 11, NULL, 3, FALSE, 0, 8, 10),
    (1, 13, 2, NULL, 3, FALSE, 0, 9, 11),
    (1, 14, 2, NULL, 3, TRUE, 0, 8, 11),
    (1, 16, 4, 11, 3, FALSE, 8, 8, 11),
    (1, 18, 7, 8, 4, FALSE, 7, 9, NULL),
    (1, 18, 16, NULL, 4, FALSE, 0, 9, NULL);
INSERT INTO action_parameter_type (kb_id, action_id, since, position, alternative, type_id) VALUES
    (1, 5, 1, 0, 0, 1),
    (1, 5, 1, 1, 0, 2),
    (1, 5, 1, 2, 0, 2),
    (1, 6, 1, 0, 0, 1),
    (1, 6, 1, 1, 0, 2);
INSERT INTO plan_step_argument (kb_id, plan_id, position, argument, object_id) VALUES
    (1, 1, 0, 0, 8),
    (1, 1, 0, 1, 10),
    (1, 1, 0, 2, 11),
    (1, 1, 1, 0, 8),
    (1, 1, 1, 1, 11),
    (1, 2, 0, 0, 9),
    (1, 2, 0, 1, 11),
    (1, 3, 0, 0, 8),
    (1, 3, 0, 1, 11),
    (1, 3, 0, 2, 10),
    (1, 3, 1, 0, 8),
    (1, 3, 1, 1, 10),
    (1, 3, 1, 2, 11),
    (1, 3, 2, 0, 8),
    (1, 3, 2, 1, 11),
    (1, 3, 3, 0, 9),
    (1, 3, 3, 1, 11),
    (1, 3, 3, 2, 10),
    (1, 3, 4, 0, 9),
    (1, 3, 4, 1, 10),
    (1, 3, 4, 2, 11),
    (1, 4, 0, 0, 9),
    (1, 4, 0, 1, 11);
INSERT INTO plan_step_version (kb_id, plan_id, position, since, until, status, text) VALUES
    (1, 1, 0, 4, NULL, 'succeeded', '(:plan 1 :step 0 succeeded)'),
    (1, 1, 1, 6, NULL, 'succeeded', '(:plan 1 :step 1 succeeded)'),
    (1, 2, 0, 7, 8, 'started', '(:plan 2 :step 0 started)'),
    (1, 2, 0, 8, NULL, 'succeeded', '(:plan 2 :step 0 succeeded)'),
    (1, 3, 0, 11, NULL, 'succeeded', '(:plan 3 :step 0 succeeded)'),
    (1, 3, 1, 12, 13, 'started', '(:plan 3 :step 1 started)'),
    (1, 3, 1, 13, NULL, 'failed', '(:plan 3 :step 1 failed)'),
    (1, 3, 2, 14, NULL, 'started', '(:plan 3 :step 2 started)'),
    (1, 3, 3, 15, NULL, 'aborted', '(:plan 3 :step 3 aborted)'),
    (1, 4, 0, 16, NULL, 'started', '(:plan 4 :step 0 started)');
INSERT INTO predicate_parameter_type (kb_id, predicate_id, since, position, alternative, type_id) VALUES
    (1, 3, 1, 0, 0, 1),
    (1, 3, 1, 1, 0, 2),
    (1, 4, 1, 0, 0, 1);
INSERT INTO revision_plan_step (kb_id, number, plan_id, position) VALUES
    (1, 4, 1, 0),
    (1, 5, 1, 1),
    (1, 6, 1, 1),
    (1, 7, 2, 0),
    (1, 8, 2, 0),
    (1, 11, 3, 0),
    (1, 13, 3, 1),
    (1, 16, 4, 0);
INSERT INTO action_term (kb_id, action_id, since, section, position, term, parameter, object_id, quantifier, variable, child) VALUES
    (1, 5, 1, 'condition', 1, 0, 0, NULL, NULL, NULL, NULL),
    (1, 5, 1, 'condition', 1, 1, 1, NULL, NULL, NULL, NULL),
    (1, 5, 1, 'effect', 2, 0, 0, NULL, NULL, NULL, NULL),
    (1, 5, 1, 'effect', 2, 1, 1, NULL, NULL, NULL, NULL),
    (1, 5, 1, 'effect', 3, 0, 0, NULL, NULL, NULL, NULL),
    (1, 5, 1, 'effect', 3, 1, 2, NULL, NULL, NULL, NULL),
    (1, 6, 1, 'condition', 2, 0, 0, NULL, NULL, NULL, NULL),
    (1, 6, 1, 'condition', 2, 1, 1, NULL, NULL, NULL, NULL),
    (1, 6, 1, 'effect', 2, 0, 0, NULL, NULL, NULL, NULL),
    (1, 6, 1, 'effect', 5, 0, 0, NULL, NULL, NULL, NULL);
