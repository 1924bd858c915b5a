"""Questions about a mechanism: assembly modes, workspace, singularities."""
