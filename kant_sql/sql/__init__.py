"""SQL: the only home of tables, statements and dialects."""
