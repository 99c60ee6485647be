"""Files from outside: they get our names, are bounded (guard.py), and are read in a process of its own."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request, Response, UploadFile

from schwung.errors import InputError
from schwung.service.api.models import RunModel
from schwung.service.incoming import What
from schwung.service.requests import Id
from schwung.service.service import Service


def router(service: Service, who: Any) -> APIRouter:
    """The routes; `who(request)` tells who asks."""
    routes = APIRouter(prefix="/api", tags=["runs"])

    @routes.post(
        "/imports",
        status_code=202,
        summary="Bring a file: session, recording, CAN log, configuration",
    )
    def bring(
        request: Request,
        response: Response,
        file: UploadFile,
        what: Annotated[What, Form()] = "session",
        options: Annotated[
            str, Form(max_length=20_000, description="Of a recording: keys of a recipe, as JSON.")
        ] = "{}",
        machine_id: Annotated[Id | None, Form()] = None,
        drive_id: Annotated[Id | None, Form()] = None,
        guess: Annotated[
            bool, Form(description="Propose the columns of a recording; import nothing yet.")
        ] = False,
        eds_file_id: Annotated[
            Id | None, Form(description="Of a CAN log: the drive's EDS, uploaded.")
        ] = None,
        dbc_file_id: Annotated[Id | None, Form(description="Of a CAN log: its DBC, uploaded.")] = None,
    ) -> RunModel:
        """A run of the kind `import`: its result has `file_id`, and `session_id` or with `guess` the `proposals`, which
        `import_as` carries out."""
        try:
            told = json.loads(options)
        except (ValueError, RecursionError) as error:
            raise InputError("options", "is not JSON", "Send an object, e.g. {}.") from error
        if not isinstance(told, dict):
            raise InputError("options", "is no object", "Send an object, e.g. {}.")
        fields = {
            "what": what,
            "options": told,
            "machine_id": machine_id,
            "drive_id": drive_id,
            "guess": guess,
            "eds_file_id": eds_file_id,
            "dbc_file_id": dbc_file_id,
        }
        run = service.bring(file.file, file.filename or "", fields, who(request))
        response.headers["Location"] = f"/api/runs/{run.id}"
        return RunModel.of(run)

    return routes
