"""Files, commands, pages, figures and exports."""
