"""One knowledge base as threads, tasks and processes share it."""
