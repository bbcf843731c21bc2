"""The accuracy report: a run folder in, one self-contained HTML page out.

    folder.py      reads a run folder, and says what is wrong with it
    wording.py     numbers, units, names of planes, parameters and sources, as a reader sees them
    facts.py       what other modules ask of the summary
    verdict.py     the answer in sentences, each made from numbers
    tables.py physical.py            rows for the tables of the page
    chart.py scale.py plate.py       draw a figure as SVG: panels, lines, dots, bars; its axes; the finished figure
    sources.py     one colour and pattern for each kind of source
    download.py    the numbers behind a figure as a CSV link
    ellipses.py ledger.py trust.py curves.py advice.py figures.py visibility.py geometry.py   the figures, by subject
    base.py        the frame of every page: base.html, macros.html, style.css, script.js, and a policy against requests
    page.py        make_report: all of it through report.html

Everything comes from the folder: no clock, no environment, so one folder gives one sequence of bytes.
"""
