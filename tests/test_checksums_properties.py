"""Seals: a record comes back whole, and any change of it is noticed."""

import copy
import json

from hypothesis import assume, given
from hypothesis import strategies as st

from generated_values import json_values, texts
from hlp.checksums import seal_is_whole, sealed

RECORDS = st.dictionaries(texts(), json_values(), max_size=5)


@given(RECORDS)
def test_a_sealed_record_is_whole_after_writing_and_reading(record):
    assume("checksum" not in record)
    written = json.loads(json.dumps(sealed(record), indent=2))
    assert seal_is_whole(written)
    assert {name: value for name, value in written.items() if name != "checksum"} == record


@given(RECORDS, texts(), json_values(), st.data())
def test_any_change_breaks_the_seal(record, name, value, data):
    assume("checksum" not in record and name != "checksum")
    whole = sealed(record)
    changed = copy.deepcopy(whole)
    if name in changed and data.draw(st.booleans()):
        del changed[name]
    else:
        changed[name] = value
    same = json.dumps(changed, sort_keys=True) == json.dumps(whole, sort_keys=True)
    assert seal_is_whole(changed) == same
