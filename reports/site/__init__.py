"""Pages as files: Markdown from templates, and all of them in one index.html."""
