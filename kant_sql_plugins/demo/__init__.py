"""`kant-sql demo`: small worlds with a story, each with a guided web page."""
