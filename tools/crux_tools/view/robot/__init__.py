"""A robot description in the browser: `crux robot show`."""
