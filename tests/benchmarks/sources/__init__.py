"""Flights that others published, as logs and vehicle files: one module a source whose format no reader knows.

A module names its repository and commit, and holds ``flights(clone)``, each flight by its name, and ``VEHICLES``, the
keys of each vehicle file by its name. The flights stay their authors'.
"""
