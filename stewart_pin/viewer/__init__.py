"""A page in the browser, to look at robots and to move them by hand."""
