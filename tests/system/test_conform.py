"""`astb rig conform`: its output for people and programs, and a rig in real time that conforms."""

import pytest

from astb.acceptance.conformance.report import Observation, Report, read_report


def test_the_command_tells_people_and_programs(astb_here, tmp_path):
    code, out, _ = astb_here(tmp_path, "rig", "conform", "virtual", "--json", "one.json")
    assert code == 0, out
    assert "0 failed" in out
    assert "SpringLeft, rate" in out
    code, out, _ = astb_here(tmp_path, "rig", "conform", "virtual", "--against", "one.json")
    assert code == 0
    assert "agree in all tests" in out
    report = read_report(tmp_path / "one.json")
    spoilt = [Observation(group=f.group, what=f.what, outcome=f.outcome, found="?") for f in report.findings]
    changed = Report(rig="other", time="real", motion=False, findings=spoilt)
    (tmp_path / "two.json").write_bytes(changed.to_json())
    code, out, _ = astb_here(tmp_path, "rig", "conform", "virtual", "--against", "two.json")
    assert code == 1
    assert "differences" in out
    code, _, err = astb_here(tmp_path, "rig", "conform", "nowhere")
    assert code == 2
    assert "there is no rig 'nowhere'" in err


@pytest.mark.slow
@pytest.mark.real_time
def test_a_rig_in_real_time_conforms(start_rig, astb_here, tmp_path):
    rig = start_rig()
    (tmp_path / "rig.toml").write_text(
        f'name = "wires"\n[can]\nbus = "tcp"\nport = {rig.can_port}\n[modbus]\nport = {rig.modbus_port}\n'
    )
    code, out, _ = astb_here(tmp_path, "rig", "conform", "rig.toml", "--allow-motion")
    assert code == 0, out
