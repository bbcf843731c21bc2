"""The accuracy report: a run folder in, one self-contained HTML page out.

    folder.py      reads a run folder, and says what is wrong with it
    wording.py     numbers, units, names of planes, parameters and sources, as a reader sees them
    verdict.py     the sentences at the top, each made from numbers
    tables.py      rows for the tables of the page
    chart.py       draws a figure as SVG: panels, lines, dots, bars; scale.py: its axes
    download.py    the numbers behind a figure as a CSV link
    plate.py       a finished figure; palette
    figures.py     sigma over time, residuals, noise-to-nuisance
    ellipses.py    prediction ellipses
    geometry.py    plan view of the ecliptic and viewing conditions
    base.py        the frame of every page: base.html, macros.html, style.css, script.js, and a policy against requests
    page.py        make_report: all of it through report.html

Everything comes from the folder: no clock, no environment, so one folder gives one sequence of bytes.
"""
