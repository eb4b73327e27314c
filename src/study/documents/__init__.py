"""What readers read: numbers set into Markdown, tables, and the typeset paper."""
