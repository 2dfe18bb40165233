"""The package of the executable `knowledge_base`; its code is `kant_sql.ros`."""
