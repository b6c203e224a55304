"""`astb rig conform`: its output for people and programs, and a rig in real time that conforms."""

import pytest
from msgspec.structs import replace

from astb.acceptance.conformance.report import Observation, Outcome, Report, read_report


def test_the_command_tells_people_and_programs(astb_here, tmp_path):
    code, out, _ = astb_here(tmp_path, "rig", "conform", "virtual", "--json", "one.json")
    assert code == 0, out
    assert "0 failed" in out
    assert "SpringLeft, rate" in out
    code, out, _ = astb_here(tmp_path, "rig", "conform", "virtual", "--against", "one.json")
    assert code == 0
    report = read_report(tmp_path / "one.json")
    ran = [one for one in report.findings if one.outcome is not Outcome.SKIPPED]
    assert f"{len(ran)} of {len(report.findings)} tests ran on both rigs" in out
    spoilt = [Observation(group=f.group, what=f.what, outcome=f.outcome, found="?") for f in report.findings]
    changed = Report(rig="other", time="real", motion=False, findings=spoilt)
    (tmp_path / "two.json").write_bytes(changed.to_json())
    code, out, _ = astb_here(tmp_path, "rig", "conform", "virtual", "--against", "two.json")
    assert code == 1
    assert "differences" in out
    renamed = Report(
        rig="other", time="real", motion=False, findings=[replace(f, what=f"{f.what}?") for f in ran]
    )
    (tmp_path / "three.json").write_bytes(renamed.to_json())
    code, out, err = astb_here(tmp_path, "rig", "conform", "virtual", "--against", "three.json")
    assert code == 2
    assert "nothing was compared" in err
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
