"""Campaigns: walls x worlds x seeds x methods, planned, checked, climbed and judged on a Dask cluster."""
