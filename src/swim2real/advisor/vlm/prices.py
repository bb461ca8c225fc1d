"""What a reply cost, by the public price list that genai-prices carries; nothing is fetched."""

from __future__ import annotations


def price(
    provider: str, model: str, input_tokens: int, output_tokens: int, cache_read: int = 0, cache_write: int = 0
) -> float | None:
    """Cost of a reply [USD]; None for a model that isn't on the list.

    Args:
        provider: `google`, `openai` or `anthropic`.
        model: That answered.
        input_tokens: All of them, those from and to the provider's cache included.
        output_tokens: With the thinking.
        cache_read: Input tokens that were found in the cache, which are cheaper.
        cache_write: Input tokens that were put there.
    """
    from genai_prices import Usage, calc_price

    usage = Usage(
        input_tokens=input_tokens,
        output_tokens=output_tokens,
        cache_read_tokens=cache_read,
        cache_write_tokens=cache_write,
    )
    try:
        return float(calc_price(usage, model, provider_id=provider).total_price)
    except LookupError:
        return None
