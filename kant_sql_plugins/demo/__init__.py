"""`kant-sql demo`: small worlds with a story, and a guided page of the web for each."""
