"""Requests by chance, made from the OpenAPI document: no server error, every answer is as the document says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.checks import CHECKS
from service_desk import ADDRESS, settings_for

from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.service import Service

_WANTED = [
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with Service(settings_for(tmp_path_factory.mktemp("openapi"))) as made:
        yield made


@pytest.fixture
def api(service: Service) -> Any:
    guard = Guard(service.settings, own_token(service.settings.folder))
    made = schemathesis.openapi.from_asgi(
        "/api/openapi.json", make_app(service, guard), headers={"Host": ADDRESS[7:]}
    )
    made.config.base_url = ADDRESS
    return made


_BUDGET = settings(
    max_examples=4, deadline=None, derandomize=True, database=None, phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)  # fmt: skip


@pytest.mark.long
def test_no_request_ends_in_a_server_error(api: Any, service: Service) -> None:
    token = own_token(service.settings.folder)
    checks = [CHECKS.get_one(name) for name in _WANTED]
    operations = [result.ok() for result in api.get_all_operations()]
    assert len(operations) > 20
    for operation in operations:

        def once(case: Any) -> None:
            answer = case.call(headers={"Authorization": f"Bearer {token}", "Host": ADDRESS[7:]})
            case.validate_response(answer, checks=checks)

        _BUDGET(given(case=operation.as_strategy())(once))()
        service.latch.release()
