"""The report: the verdict sentence, the pictures, the tests, the fine print."""

from sim.discover.discover import Investigation
from sim.discover.finding import Finding
from sim.discover.words import console_lines
from sim.report import make_page, paragraph, table

METHOD = (
    "How it was judged: the believed terms were fitted, every flight's own start (tracks) or the scatter of the launch "
    "(outcomes) with them. Each test asks whether a small extra effect goes with a covariate; what the fitted "
    "coefficients could explain is taken out of its score first. The p-value of a test is the chance that the largest "
    "of all these tests comes out as large when the signs of the clusters' scores are drawn at random. Stage "
    "probabilities and gains come from shots that the correction had not seen.")


def make_report(name: str, investigation: Investigation) -> str:
    """HTML text of the answer about the dataset called `name`."""
    finding = investigation.finding
    sections = [("", "".join(paragraph(line) for line in console_lines(finding)[1:]))]
    sections += make_pictures(investigation)
    if finding.mismatch.tests:
        sections.append(("The tests", _tests(finding)))
    if finding.fit:
        sections.append(("On shots that the fit had not seen", _fit(finding)))
    sections.append(("Fine print", paragraph(METHOD, dim=True)))
    return make_page(f"truearc discover: {name}", finding.sentence, sections)


def make_pictures(investigation: Investigation) -> list[tuple[str, str]]:
    """(heading, HTML) of what is missing; none of a dataset that carries no test."""
    del investigation
    return []


def _tests(finding: Finding) -> str:
    rows = [(key, test.stage, test.direction, test.shape, test.statistic, test.p_value, test.amplitude, test.unit,
             test.log_gain) for key, test in finding.mismatch.tests.items()]
    return table(("test", "stage", "direction", "shape", "standard errors", "p in the family", "amplitude", "unit",
                  "log-likelihood"), rows) + paragraph(
        f"{finding.mismatch.tests_made} tests were made; of each channel and covariate the strongest shape is listed.",
        dim=True)


def _fit(finding: Finding) -> str:
    fit = finding.fit
    if fit is None:
        return ""
    rows = [("log score a shot", fit.log_score_before, fit.log_score_after),
            ("height error, rms [m]", fit.height_rmse_before_m, fit.height_rmse_after_m),
            ("share of outcomes foretold", fit.accuracy_before, fit.accuracy_after)]
    shown = [row for row in rows if row[1] is not None]
    gain = f"Gain a shot: {fit.gain_per_shot:.3g} ± {fit.gain_se:.2g} nats." if fit.gain_per_shot is not None else ""
    return table(("", "as simulated", "with the free correction"), shown) + (paragraph(gain) if gain else "")
