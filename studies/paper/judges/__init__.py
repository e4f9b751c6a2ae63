"""From the data to a finding, for every statement of the paper.

Criteria are fixed here, and stated in `studies.paper.statements`; the paper's own numbers are the
only ones that are written down.
"""
