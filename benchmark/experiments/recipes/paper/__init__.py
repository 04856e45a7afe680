"""The paper's experiment: Tables I to VII, Figures 5 to 9 and the findings, from measured cells."""
