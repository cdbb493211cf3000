"""The LaTeX table: every number once, undetermined ones as dashes, names escaped."""

from report_material import a_result

from rotorfit.report.parameters import latex_table


def test_the_table_of_two_configurations(assert_wording):
    lines = latex_table(a_result(name="50 % & more_")).splitlines()
    assert lines[2].startswith("\\caption{50 \\%")
    assert_wording(lines[2])
    assert_wording(lines)
    rows = {line.split(" & ")[1]: line for line in lines if line.endswith(r"\\") and "$" in line}
    assert "\\multicolumn{2}{c}{$(3.630 \\pm 0.020) \\times" in rows["$k_t$"]
    assert "10^{-6}$}" in rows["$k_t$"]
    assert_wording(rows["$k_t$"])
    assert rows["$k_d$"].split(" & ")[2] == r"\multicolumn{2}{c}{--}"
    assert rows["$m$"].split(" & ")[2:4] == [r"$1.285$$^{g}$"] * 2
    assert rows["$I_{zz}$"].split(" & ")[2:4] == ["--", "--"]
    assert rows["$I_{xx}$"].endswith(r"& $\mathrm{kg\,m^2}$ \\")


def test_it_is_balanced_and_ascii():
    text = latex_table(a_result())
    assert text.isascii()
    assert text.count("{") == text.count("}")
    assert text.count("$") % 2 == 0
