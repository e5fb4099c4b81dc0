"""The command line: what it is called with, what it prints and what it writes.

cli.py                      the commands and their options
commands.py, catalogue.py   what each of them does
output.py, interrupt.py     the folder of results, whole or not at all
result_json.py, terminal.py results as JSON and as tables
"""
