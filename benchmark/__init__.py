"""What measures methods: odometers, surface fusion, perturbations, third-party systems, and the
experiments that run them on sequences.

It stands on the library, which never imports it; `iclnuim.NAME` reaches its public names where it
is installed.
"""
