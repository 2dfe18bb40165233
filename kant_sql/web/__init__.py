"""The web application: pages, reports and their JSON, all read-only (the extra `web`)."""
