"""Archives: versions that ended long ago, moved into another store."""
