"""The analyst's page: a campaign's recordings in a browser on this machine; see docs/view.md."""
