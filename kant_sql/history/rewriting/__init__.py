"""How an erasure rewrites texts, and the commitments that it keeps."""
