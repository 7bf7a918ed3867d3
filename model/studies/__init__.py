"""The paper's studies on networks of one's own: a folder a study, registered in `registry`.

Each study has the same modules: `command` (its click command), `study` (the computation),
`results` (the contract of its JSON file and its section of the report), and where needed `plot` or
`sheet` (its picture). Studies that compare trainings share the package `trials`.
"""
