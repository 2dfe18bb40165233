"""The Model Context Protocol: questions as tools for programs with language models."""
