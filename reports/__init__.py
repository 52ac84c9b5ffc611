"""Pages made from the measurements of `bench`."""
