"""The accuracy report: a folder in, one self-contained HTML page out.

    kit     what pages are made of: frame, styles, tables, figures, maps, target planes, wording
    run fit risk ...     the pages by kind of folder, each with the subjects of its figures

Everything comes from the folder: no clock, no environment, so one folder gives one sequence of bytes.
"""
