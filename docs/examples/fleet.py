"""Questions to the store that replay diagnose FOLDER wrote.

python docs/examples/fleet.py STORE
"""

import sqlite3
import sys

if len(sys.argv) < 2:
    sys.exit(__doc__)
store = sqlite3.connect(f"file:{sys.argv[1]}?mode=ro", uri=True)
print("logs by verdict:")
for verdict, count in store.execute("SELECT verdict, count(*) FROM logs GROUP BY verdict"):
    print(f"  {verdict or 'not judged'}: {count}")
print("vehicles by effect:")
question = """SELECT effect, count(DISTINCT vehicle) FROM effects JOIN logs USING (sha256, question)
    GROUP BY effect ORDER BY 2 DESC"""
for effect, count in store.execute(question):
    print(f"  {effect}: {count}")
