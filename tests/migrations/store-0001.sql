-- What version 0001 wrote: two knowledge bases with facts, goals and actions that came and went.
-- Frozen, as the migration is. It runs on SQLite and PostgreSQL.

INSERT INTO knowledge_base (id, name) VALUES
    (1, 'tiago'),
    (2, 'Küche 🤖');

INSERT INTO head (kb_id, revision, definition_revision, next_id, hash, committed_at) VALUES
    (1, 6, 6, 17, 'e6046bf14be3c0862abbe87b2bf4c86870206f4632c7a321326d348c53cfdc64', '2026-01-31T09:36:01.500000Z'),
    (2, 2, 2, 7, 'e658420c880f36f9d7ddcb4868e3938c655f0f7a573582333c74d9a5a003edbf', '2026-01-31T09:38:02.000000Z');

INSERT INTO revision (kb_id, number, committed_at, actor, reason, source, form, hash) VALUES
    (1, 1, '2026-01-31T09:31:00.250000Z', 'perception', NULL, NULL, 1, '1809b11b674dbed75ddfa4c157387388cf3b5a3091470ee58270ca084d43bb06'),
    (1, 2, '2026-01-31T09:32:00.500000Z', 'perception', NULL, '{"map":"ground floor","scale":0.05}', 1, '574c90fab1dd7c1ab31f17dd60fdd559cdc822a41d94aa10eb628e53c40af663'),
    (1, 3, '2026-01-31T09:33:00.750000Z', 'perception', NULL, NULL, 1, '64ae296eee306c5ce5f8eb743008184685cb5eea1d066a2c7e8b4868de2f9a30'),
    (1, 4, '2026-01-31T09:34:01.000000Z', 'executive', 'it''s there
at last', NULL, 1, 'f7d11ad38d9e1ff7858a15b3fcb8740f290fb514c905981f919beef150c9d336'),
    (1, 5, '2026-01-31T09:35:01.250000Z', 'perception', NULL, NULL, 1, 'e66b07f0debfc4874ee44d719333ee14e645e8a65ae07d86ba139fc61c4badc8'),
    (1, 6, '2026-01-31T09:36:01.500000Z', 'perception', NULL, NULL, 1, 'e6046bf14be3c0862abbe87b2bf4c86870206f4632c7a321326d348c53cfdc64'),
    (2, 1, '2026-01-31T09:37:01.750000Z', NULL, NULL, NULL, 1, '0f83062b10aeb496f45ac0cb4fa097e50b23a730363332426e93a23b10797e77'),
    (2, 2, '2026-01-31T09:38:02.000000Z', NULL, NULL, NULL, 1, 'e658420c880f36f9d7ddcb4868e3938c655f0f7a573582333c74d9a5a003edbf');

INSERT INTO type (kb_id, id, name, key) VALUES
    (1, 1, 'robot', 'robot'),
    (1, 2, 'place', 'place'),
    (1, 5, 'wp', 'wp'),
    (2, 1, 'robot', 'robot');

INSERT INTO type_version (kb_id, type_id, since, until, parent_id, text) VALUES
    (1, 1, 1, NULL, NULL, 'robot'),
    (1, 2, 1, NULL, NULL, 'place'),
    (1, 5, 1, NULL, 2, 'wp - place'),
    (2, 1, 1, NULL, NULL, 'robot');

INSERT INTO object (kb_id, id, name, key) VALUES
    (1, 4, 'rb1', 'rb1'),
    (1, 6, 'wp1', 'wp1'),
    (1, 8, 'wp2', 'wp2'),
    (1, 9, 'dock', 'dock'),
    (2, 3, 'rb1', 'rb1');

INSERT INTO object_version (kb_id, object_id, since, until, type_id, text) VALUES
    (1, 4, 1, NULL, 1, 'rb1 - robot'),
    (1, 6, 1, NULL, 5, 'wp1 - wp'),
    (1, 8, 2, NULL, 5, 'wp2 - wp'),
    (1, 9, 2, NULL, 5, 'dock - wp'),
    (2, 3, 1, NULL, 1, 'rb1 - robot');

INSERT INTO predicate (kb_id, id, name, key) VALUES
    (1, 3, 'robot_at', 'robot_at'),
    (1, 10, 'free', 'free'),
    (1, 12, 'idle', 'idle'),
    (2, 2, 'idle', 'idle');

INSERT INTO predicate_version (kb_id, predicate_id, since, until, text) VALUES
    (1, 3, 1, NULL, '(robot_at ?r0 - robot ?p1 - place)'),
    (1, 10, 2, NULL, '(free ?p0 - place)'),
    (1, 12, 2, NULL, '(idle ?r0 - robot)'),
    (2, 2, 1, NULL, '(idle ?r0 - robot)');

INSERT INTO predicate_parameter (kb_id, predicate_id, since, position, name) VALUES
    (1, 3, 1, 0, 'r0'),
    (1, 3, 1, 1, 'p1'),
    (1, 10, 2, 0, 'p0'),
    (1, 12, 2, 0, 'r0'),
    (2, 2, 1, 0, 'r0');

INSERT INTO predicate_parameter_type (kb_id, predicate_id, since, position, alternative, type_id) VALUES
    (1, 3, 1, 0, 0, 1),
    (1, 3, 1, 1, 0, 2),
    (1, 10, 2, 0, 0, 2),
    (1, 12, 2, 0, 0, 1),
    (2, 2, 1, 0, 0, 1);

INSERT INTO action (kb_id, id, name, key) VALUES
    (1, 11, 'navigation', 'navigation'),
    (1, 13, 'wait', 'wait'),
    (2, 6, 'rest', 'rest');

INSERT INTO action_version (kb_id, action_id, since, until, durative, text) VALUES
    (1, 11, 2, 5, true, '(:durative-action navigation
	:parameters ( ?r - robot ?s - wp ?d - place)
	:duration (= ?duration 10)
	:condition (and
		(at start (robot_at ?r ?s))
		(over all (free ?d))
		(at end (not (robot_at ?r dock)))
	)
	:effect (and
		(at start (not (robot_at ?r ?s)))
		(at end (robot_at ?r ?d))
	)
)'),
    (1, 11, 5, NULL, true, '(:durative-action navigation
	:parameters ( ?r - robot ?s - wp ?d - place)
	:duration (= ?duration 12.5)
	:condition (and
		(at start (robot_at ?r ?s))
		(over all (free ?d))
		(at end (not (robot_at ?r dock)))
	)
	:effect (and
		(at start (not (robot_at ?r ?s)))
		(at end (robot_at ?r ?d))
	)
)'),
    (1, 13, 2, 6, false, '(:action wait
	:parameters ( ?r - robot)
	:precondition (and
		(idle ?r)
		(not (robot_at ?r dock))
	)
	:effect (and
		(not (idle ?r))
	)
)'),
    (2, 6, 2, NULL, true, '(:durative-action rest
	:parameters ( ?r - robot)
	:duration (= ?duration 10)
	:condition (and
	)
	:effect (and
		(at end (idle ?r))
	)
)');

INSERT INTO action_parameter (kb_id, action_id, since, position, name) VALUES
    (1, 11, 2, 0, 'r'),
    (1, 11, 2, 1, 's'),
    (1, 11, 2, 2, 'd'),
    (1, 11, 5, 0, 'r'),
    (1, 11, 5, 1, 's'),
    (1, 11, 5, 2, 'd'),
    (1, 13, 2, 0, 'r'),
    (2, 6, 2, 0, 'r');

INSERT INTO action_parameter_type (kb_id, action_id, since, position, alternative, type_id) VALUES
    (1, 11, 2, 0, 0, 1),
    (1, 11, 2, 1, 0, 5),
    (1, 11, 2, 2, 0, 2),
    (1, 11, 5, 0, 0, 1),
    (1, 11, 5, 1, 0, 5),
    (1, 11, 5, 2, 0, 2),
    (1, 13, 2, 0, 0, 1),
    (2, 6, 2, 0, 0, 1);

INSERT INTO action_expression (kb_id, action_id, since, section, position, parent, operator, predicate_id, value) VALUES
    (1, 11, 2, 'condition', 0, NULL, 'and', NULL, NULL),
    (1, 11, 2, 'condition', 1, 0, 'at start', NULL, NULL),
    (1, 11, 2, 'condition', 2, 1, 'predicate', 3, NULL),
    (1, 11, 2, 'condition', 3, 0, 'over all', NULL, NULL),
    (1, 11, 2, 'condition', 4, 3, 'predicate', 10, NULL),
    (1, 11, 2, 'condition', 5, 0, 'at end', NULL, NULL),
    (1, 11, 2, 'condition', 6, 5, 'not', NULL, NULL),
    (1, 11, 2, 'condition', 7, 6, 'predicate', 3, NULL),
    (1, 11, 2, 'duration', 0, NULL, '=', NULL, NULL),
    (1, 11, 2, 'duration', 1, 0, 'variable', NULL, '?duration'),
    (1, 11, 2, 'duration', 2, 0, 'number', NULL, '10'),
    (1, 11, 2, 'effect', 0, NULL, 'and', NULL, NULL),
    (1, 11, 2, 'effect', 1, 0, 'at start', NULL, NULL),
    (1, 11, 2, 'effect', 2, 1, 'not', NULL, NULL),
    (1, 11, 2, 'effect', 3, 2, 'predicate', 3, NULL),
    (1, 11, 2, 'effect', 4, 0, 'at end', NULL, NULL),
    (1, 11, 2, 'effect', 5, 4, 'predicate', 3, NULL),
    (1, 11, 5, 'condition', 0, NULL, 'and', NULL, NULL),
    (1, 11, 5, 'condition', 1, 0, 'at start', NULL, NULL),
    (1, 11, 5, 'condition', 2, 1, 'predicate', 3, NULL),
    (1, 11, 5, 'condition', 3, 0, 'over all', NULL, NULL),
    (1, 11, 5, 'condition', 4, 3, 'predicate', 10, NULL),
    (1, 11, 5, 'condition', 5, 0, 'at end', NULL, NULL),
    (1, 11, 5, 'condition', 6, 5, 'not', NULL, NULL),
    (1, 11, 5, 'condition', 7, 6, 'predicate', 3, NULL),
    (1, 11, 5, 'duration', 0, NULL, '=', NULL, NULL),
    (1, 11, 5, 'duration', 1, 0, 'variable', NULL, '?duration'),
    (1, 11, 5, 'duration', 2, 0, 'number', NULL, '12.5'),
    (1, 11, 5, 'effect', 0, NULL, 'and', NULL, NULL),
    (1, 11, 5, 'effect', 1, 0, 'at start', NULL, NULL),
    (1, 11, 5, 'effect', 2, 1, 'not', NULL, NULL),
    (1, 11, 5, 'effect', 3, 2, 'predicate', 3, NULL),
    (1, 11, 5, 'effect', 4, 0, 'at end', NULL, NULL),
    (1, 11, 5, 'effect', 5, 4, 'predicate', 3, NULL),
    (1, 13, 2, 'condition', 0, NULL, 'and', NULL, NULL),
    (1, 13, 2, 'condition', 1, 0, 'predicate', 12, NULL),
    (1, 13, 2, 'condition', 2, 0, 'not', NULL, NULL),
    (1, 13, 2, 'condition', 3, 2, 'predicate', 3, NULL),
    (1, 13, 2, 'effect', 0, NULL, 'and', NULL, NULL),
    (1, 13, 2, 'effect', 1, 0, 'not', NULL, NULL),
    (1, 13, 2, 'effect', 2, 1, 'predicate', 12, NULL),
    (2, 6, 2, 'condition', 0, NULL, 'and', NULL, NULL),
    (2, 6, 2, 'duration', 0, NULL, '=', NULL, NULL),
    (2, 6, 2, 'duration', 1, 0, 'variable', NULL, '?duration'),
    (2, 6, 2, 'duration', 2, 0, 'number', NULL, '10'),
    (2, 6, 2, 'effect', 0, NULL, 'and', NULL, NULL),
    (2, 6, 2, 'effect', 1, 0, 'at end', NULL, NULL),
    (2, 6, 2, 'effect', 2, 1, 'predicate', 2, NULL);

INSERT INTO action_expression_term (kb_id, action_id, since, section, position, term, parameter, object_id) VALUES
    (1, 11, 2, 'condition', 2, 0, 0, NULL),
    (1, 11, 2, 'condition', 2, 1, 1, NULL),
    (1, 11, 2, 'condition', 4, 0, 2, NULL),
    (1, 11, 2, 'condition', 7, 0, 0, NULL),
    (1, 11, 2, 'condition', 7, 1, NULL, 9),
    (1, 11, 2, 'effect', 3, 0, 0, NULL),
    (1, 11, 2, 'effect', 3, 1, 1, NULL),
    (1, 11, 2, 'effect', 5, 0, 0, NULL),
    (1, 11, 2, 'effect', 5, 1, 2, NULL),
    (1, 11, 5, 'condition', 2, 0, 0, NULL),
    (1, 11, 5, 'condition', 2, 1, 1, NULL),
    (1, 11, 5, 'condition', 4, 0, 2, NULL),
    (1, 11, 5, 'condition', 7, 0, 0, NULL),
    (1, 11, 5, 'condition', 7, 1, NULL, 9),
    (1, 11, 5, 'effect', 3, 0, 0, NULL),
    (1, 11, 5, 'effect', 3, 1, 1, NULL),
    (1, 11, 5, 'effect', 5, 0, 0, NULL),
    (1, 11, 5, 'effect', 5, 1, 2, NULL),
    (1, 13, 2, 'condition', 1, 0, 0, NULL),
    (1, 13, 2, 'condition', 3, 0, 0, NULL),
    (1, 13, 2, 'condition', 3, 1, NULL, 9),
    (1, 13, 2, 'effect', 2, 0, 0, NULL),
    (2, 6, 2, 'effect', 2, 0, 0, NULL);

INSERT INTO proposition (kb_id, id, predicate_id, is_goal, arguments, text) VALUES
    (1, 7, 3, false, '4 6', '(robot_at rb1 wp1)'),
    (1, 14, 3, true, '4 8', '(robot_at rb1 wp2)'),
    (1, 15, 3, false, '4 8', '(robot_at rb1 wp2)'),
    (1, 16, 3, true, '4 9', '(robot_at rb1 dock)'),
    (2, 4, 2, false, '3', '(idle rb1)'),
    (2, 5, 2, true, '3', '(idle rb1)');

INSERT INTO proposition_argument (kb_id, proposition_id, position, object_id) VALUES
    (1, 7, 0, 4),
    (1, 7, 1, 6),
    (1, 14, 0, 4),
    (1, 14, 1, 8),
    (1, 15, 0, 4),
    (1, 15, 1, 8),
    (1, 16, 0, 4),
    (1, 16, 1, 9),
    (2, 4, 0, 3),
    (2, 5, 0, 3);

INSERT INTO proposition_version (kb_id, proposition_id, since, until, predicate_id) VALUES
    (1, 7, 1, 4, 3),
    (1, 14, 3, 4, 3),
    (1, 15, 4, NULL, 3),
    (1, 16, 4, NULL, 3),
    (2, 4, 1, NULL, 2),
    (2, 5, 1, NULL, 2);
