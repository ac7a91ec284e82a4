"""A review in a browser, as a person uses it."""

NOW, OPENED = 3, 1  # columns of the table of values


class Screen:
    """The page as a person uses it: what is to be read, clicks at px of the clip, keys."""

    def __init__(self, driver, address, size=(320, 180)):
        from selenium.webdriver.common.by import By

        self.driver, self.size, self.by = driver, size, By
        if address is not None:
            driver.get(address)
            self.until(lambda: self.text("fit-status").startswith("fitted"))

    def find(self, name):
        return self.driver.find_element(self.by.ID, name)

    def text(self, name):
        return self.find(name).text

    def until(self, done, timeout_s=30):
        from selenium.common.exceptions import StaleElementReferenceException, TimeoutException, WebDriverException
        from selenium.webdriver.support.ui import WebDriverWait

        ignored = (StaleElementReferenceException, WebDriverException)
        try:
            WebDriverWait(self.driver, timeout_s, 0.05, ignored_exceptions=ignored).until(lambda _: done())
        except TimeoutException as error:
            shown = [self.text(name) for name in ("message", "question-text", "where", "scene", "fit-status")]
            raise AssertionError(f"not in {timeout_s} s; the page shows {shown}") from error

    def keys(self, *keys):
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()

    def at(self, x, y):
        """The offset of a point of the clip from the middle of the stage, px of the screen."""
        stage = self.find("stage").rect
        zoom = min(stage["width"] / self.size[0], stage["height"] / self.size[1])
        return round((x + 0.5 - self.size[0] / 2) * zoom), round((y + 0.5 - self.size[1] / 2) * zoom)

    def click(self, x, y):
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.driver).move_to_element_with_offset(self.find("stage"), *self.at(x, y)).click().perform()

    def drag(self, start, end):
        from selenium.webdriver.common.action_chains import ActionChains

        chain = ActionChains(self.driver).move_to_element_with_offset(self.find("stage"), *self.at(*start))
        chain = chain.click_and_hold().move_by_offset(6, 0)
        chain.move_to_element_with_offset(self.find("stage"), *self.at(*end)).release().perform()

    def go_to(self, frame):
        from selenium.webdriver.common.action_chains import ActionChains
        from selenium.webdriver.common.keys import Keys

        self.keys(Keys.HOME)
        self.until(lambda: self.text("where").startswith("frame 0 "))
        tens, ones = [Keys.ARROW_RIGHT] * (frame // 10), [Keys.ARROW_RIGHT] * (frame % 10)
        ActionChains(self.driver).key_down(Keys.SHIFT).send_keys(*tens).key_up(Keys.SHIFT).send_keys(*ones).perform()
        self.until(lambda: self.text("where").startswith(f"frame {frame} "))

    def value(self, name, column):
        """What a cell shows, read in one step: the page draws the table anew after each fit."""
        script = "return document.querySelectorAll(arguments[0])[arguments[1]]?.innerText.trim() ?? ''"
        return self.driver.execute_script(script, f"#values tr[data-name='{name}'] :is(th, td)", column)

    def errors(self):
        return [entry for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
