"""A page in the browser: drag the target, and see the arm that reaches it; see page.Page."""
