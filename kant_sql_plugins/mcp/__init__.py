"""The Model Context Protocol: questions as tools of programs that are built on language models."""
