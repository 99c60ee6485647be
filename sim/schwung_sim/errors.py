"""What the virtual machine room raises on wrong use."""


class BenchError(Exception):
    """The bench was asked for something that it cannot do: place, problem and remedy in one sentence."""

    def __init__(self, place: str, problem: str, remedy: str = "") -> None:
        self.place, self.problem, self.remedy = place, problem, remedy
        super().__init__(place, problem, remedy)

    def __str__(self) -> str:
        sentence = f"{self.place}: {self.problem}"
        return f"{sentence}. {self.remedy}" if self.remedy else sentence
