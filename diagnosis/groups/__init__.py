"""What differs between groups of trials, and what changes in the course of a long log.

Both ask whether a value differs by group: each unit, a run or a spell of hours, has a slope and an information of
values of its own, a contrast of the units is tested, the strongest is named and taken out, and the rest is tested
again. They keep two laws. Groups are given: the contrasts are known, runs scatter independently and share coefficients
with priors, and the statistic follows an F (``fitting.uncertainty.group_test``). A date is looked for among hundreds of
contrasts, and neighbouring spells have their weather in common: of a month without a change, but with weather for a day
as large as the error of a spell, the F of the best step, corrected for the number of steps, is below 5 % in 13 of 20
series and below 0.1 % in 6. So that law is bootstrapped (``over_time``); of six runs a bootstrap would say nothing.
"""
