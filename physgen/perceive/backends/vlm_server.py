"""A vision-language model behind an OpenAI-compatible server; one message for each kind of failure."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NoReturn

import openai

from physgen.perceive.backends.vlm_client import (
    KEY,
    MODEL,
    OPENAI_KEY,
    URL,
    Query,
    Reply,
    Settings,
    Turn,
    plain_line,
    server_schema,
)
from physgen.problems import InputError

OPTIONAL = ("response_format", "seed", "temperature")
"""Parameters that some servers do not know: left out, in this order, when a request is refused."""
LENGTH, NEWER_LENGTH = "max_tokens", "max_completion_tokens"


class Server:
    """A server's model, called through the openai library, which waits and retries where that may help."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._unknown: set[str] = set()
        self._client: Any = openai.OpenAI(
            base_url=settings.url,
            api_key=settings.key or "none",
            timeout=settings.timeout,
            max_retries=settings.retries,
        )

    def complete(self, query: Query, turns: Sequence[Turn], seed: int) -> Reply:
        """The reply to a question, after `turns` about unusable answers. Raises InputError."""
        retries = 0
        while True:
            unknown = frozenset(self._unknown)
            try:
                raw = self._client.chat.completions.with_raw_response.create(
                    **self._request(query, turns, seed, unknown)
                )
                if (reply := _reply(raw)) is None:
                    raise openai.OpenAIError(f"no chat completion: {raw.text}")
                return replace(reply, retries=retries + raw.retries_taken)
            except (openai.BadRequestError, openai.UnprocessableEntityError) as error:
                left = [name for name in OPTIONAL if name not in unknown]
                named = [name for name in left if name in error.message]
                if NEWER_LENGTH in error.message and LENGTH not in unknown:
                    named = [LENGTH]
                if not named and not left:
                    self._fail(query, error)
                self._unknown |= set(named or left[:1])
                retries += 1
            except openai.OpenAIError as error:
                self._fail(query, error)

    def close(self) -> None:
        """Close the connections."""
        self._client.close()

    def _request(
        self, query: Query, turns: Sequence[Turn], seed: int, unknown: frozenset[str]
    ) -> dict[str, Any]:
        schema = server_schema(query.schema)
        optional: dict[str, Any] = {
            "response_format": {
                "type": "json_schema",
                "json_schema": {"name": "answer", "strict": True, "schema": schema},
            },
            "seed": seed,
            "temperature": self._settings.temperature,
        }
        text = query.text
        if "response_format" in unknown:
            text = f"{text}\n\nThe JSON schema of the answer:\n{json.dumps(schema)}"
        content: list[dict[str, Any]] = [{"type": "text", "text": text}]
        for picture in query.pictures:
            url = f"data:image/png;base64,{b64encode(picture).decode()}"
            content.append({"type": "image_url", "image_url": {"url": url}})
        messages: list[dict[str, Any]] = [{"role": "user", "content": content}]
        messages += [{"role": turn.role, "content": turn.text} for turn in turns]
        request: dict[str, Any] = {"model": self._settings.model, "messages": messages}
        if self._settings.max_tokens is not None:
            request[NEWER_LENGTH if LENGTH in unknown else LENGTH] = self._settings.max_tokens
        return request | {name: value for name, value in optional.items() if name not in unknown}

    def _fail(self, query: Query, error: openai.OpenAIError) -> NoReturn:
        """One message: the failure, the server and model, and the fix; never the key."""
        settings = self._settings
        found = f"{settings.where} (model {settings.model}), asked for {settings.role} of {query.about},"
        tries = settings.retries + 1
        count = f"{tries} times" if tries > 1 else "once"
        fix = "try again later, set retries below [vlm] in physgen.toml, or allow --fallback"
        if isinstance(error, openai.APITimeoutError):
            what = f"did not answer within {settings.timeout:g} s, tried {count}"
            fix = "set timeout below [vlm] in physgen.toml to more seconds, see whether it hangs, or allow --fallback"
        elif isinstance(error, openai.APIConnectionError):
            cause = error.__cause__ or error
            what = f"cannot be reached or broke off, tried {count} ({self._error_text(cause)})"
            fix = f"see whether it runs and {URL} is right, or allow --fallback"
        elif isinstance(error, openai.AuthenticationError | openai.PermissionDeniedError):
            what = (
                f"refuses the key ({error.status_code})"
                if settings.key
                else f"wants a key ({error.status_code})"
            )
            fix = f"set {KEY}, or {OPENAI_KEY}, to a key of that server"
        elif isinstance(error, openai.NotFoundError):
            what = f"knows no such page or model (404: {self._error_text(error)})"
            fix = f"check {MODEL}, and that {URL} ends as the server wants it, mostly in /v1"
        elif isinstance(error, openai.RateLimitError):
            what = f"is too busy, or its quota is used up, tried {count} (429: {self._error_text(error)})"
        elif isinstance(error, openai.APIStatusError) and error.status_code >= 500:
            what = f"fails, tried {count} ({error.status_code}: {self._error_text(error)})"
        elif isinstance(error, openai.APIStatusError):
            what = f"refuses the question ({error.status_code}: {self._error_text(error)})"
            fix = "see whether that model takes pictures, or choose another"
        else:
            what = f"gave what cannot be read ({self._error_text(error)})"
            fix = f"check that {URL} is that of an OpenAI-compatible server, mostly ending in /v1"
        raise InputError.of("--backend", found, what, fix) from None

    def _error_text(self, error: BaseException) -> str:
        """An error's text on one line, without the key."""
        body = getattr(error, "body", None)
        text = body.get("message") if isinstance(body, dict) else None
        line = plain_line(text if isinstance(text, str) else str(error) or type(error).__name__, 10_000)
        line = line.replace(self._settings.key, "***") if self._settings.key else line
        return plain_line(line, 160)


def _reply(raw: Any) -> Reply | None:
    """A response's content; None where it is no chat completion, e.g. a web page."""
    try:
        completion = raw.parse()
        choices, usage = completion.choices, completion.usage
    except (ValueError, AttributeError, openai.APIResponseValidationError):
        return None
    if choices is None:
        return None
    message = choices[0].message if choices else None
    text, refusal = (getattr(message, name, None) for name in ("content", "refusal"))
    content = next((part for part in (text, refusal) if isinstance(part, str)), "")
    tokens_in, tokens_out = (getattr(usage, key, None) or 0 for key in ("prompt_tokens", "completion_tokens"))
    return Reply(content, tokens_in, tokens_out, cut=bool(choices) and choices[0].finish_reason == "length")
