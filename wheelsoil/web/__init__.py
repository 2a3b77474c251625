"""Parts that the logger's page and the analyst's page share: access rules, addresses, HTTP server."""
