"""What else one could predict outcomes with from the recorded configurations alone, each tuned by cross-validation.

All classify into miss, two and three and answer in the gate's terms: p_two = P(two or three), p_three = P(three).
"""

import warnings
from collections.abc import Callable

import numpy as np
from sklearn.ensemble import GradientBoostingClassifier
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessClassifier
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV, StratifiedKFold
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from truearc.sim.paper.network import Rows

FOLDS = 5
Predict = Callable[[np.ndarray], np.ndarray]
Choices = dict[str, list[int] | list[float]]


def fit_baselines(rows: Rows, seed: int) -> dict[str, Predict]:
    """name -> function from features [n, 3] to p [n, 2]; the same rows and seed give the same functions."""
    return {"logistic regression": _fit_tuned(_logistic(), rows, seed),
            "gradient-boosted trees": _fit_tuned(_trees(seed), rows, seed),
            "Gaussian process": _predictor(_fit_process(rows, seed))}


def _logistic() -> tuple[Pipeline, Choices]:
    model = make_pipeline(StandardScaler(), PolynomialFeatures(include_bias=False), LogisticRegression(max_iter=5000))
    return model, {"polynomialfeatures__degree": [1, 2], "logisticregression__C": [0.3, 3.0, 30.0]}


def _trees(seed: int) -> tuple[Pipeline, Choices]:
    model = make_pipeline(GradientBoostingClassifier(subsample=0.8, random_state=seed))
    return model, {"gradientboostingclassifier__n_estimators": [30, 100],
                   "gradientboostingclassifier__max_depth": [2, 3]}


def _fit_process(rows: Rows, seed: int) -> Pipeline:
    """One process for each outcome against the others; scales by marginal likelihood, so nothing is left to tune."""
    kernel = ConstantKernel(10.0, (0.1, 1e4)) * RBF([1.0, 1.0, 1.0], (0.05, 100.0))
    model = make_pipeline(StandardScaler(), GaussianProcessClassifier(kernel, random_state=seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)       # a scale at its bound: that input is not informative
        return model.fit(rows.features, _classes(rows))


def _fit_tuned(tunable: tuple[Pipeline, Choices], rows: Rows, seed: int) -> Predict:
    model, choices = tunable
    classes = _classes(rows)
    folds = StratifiedKFold(min(FOLDS, int(np.bincount(classes)[np.unique(classes)].min())), shuffle=True,
                            random_state=seed)
    search = GridSearchCV(model, choices, scoring="neg_log_loss", cv=folds)
    return _predictor(search.fit(rows.features, classes))


def _classes(rows: Rows) -> np.ndarray:
    """0 miss, 1 two, 2 three."""
    level: np.ndarray = rows.labels.sum(axis=1).round().astype(int)
    return level


def _predictor(model: Pipeline | GridSearchCV) -> Predict:
    def predict(features: np.ndarray) -> np.ndarray:
        by_class = dict(zip(model.classes_.tolist(), model.predict_proba(features).T, strict=True))
        none = np.zeros(len(features))
        three = by_class.get(2, none)
        return np.column_stack([by_class.get(1, none) + three, three])

    return predict
